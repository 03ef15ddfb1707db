// Eight floats at once: arithmetic of GCC's and Clang's vector types, whatever the machine has.
#pragma once

#ifdef __AVX2__
#include <immintrin.h>
#endif

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <utility>

namespace countershade {

constexpr int kLanes = 8;
using Lanes = float __attribute__((vector_size(4 * kLanes)));
using LaneBits = std::uint32_t __attribute__((vector_size(4 * kLanes)));
using LaneMask = std::int32_t __attribute__((vector_size(4 * kLanes)));  // of comparisons: all bits or none
using LaneWords = std::uint16_t __attribute__((vector_size(2 * kLanes)));

constexpr LaneMask kLane = {0, 1, 2, 3, 4, 5, 6, 7};

inline Lanes all(float v) {
  return Lanes{} + v;
}
inline Lanes masked(LaneMask mask, Lanes values) {
  return std::bit_cast<Lanes>(mask & std::bit_cast<LaneMask>(values));
}
inline Lanes absolute(Lanes v) {
  return masked(LaneMask{} + 0x7fffffff, v);
}
// b where one of them is NaN.
inline Lanes larger(Lanes a, Lanes b) {
  return a > b ? a : b;
}
inline Lanes smaller(Lanes a, Lanes b) {
  return a < b ? a : b;
}
inline Lanes root(Lanes v) {
#ifdef __AVX2__
  return std::bit_cast<Lanes>(_mm256_sqrt_ps(std::bit_cast<__m256>(v)));
#else
  for (int i = 0; i < kLanes; ++i) v[i] = std::sqrt(v[i]);
  return v;
#endif
}
// Median of seven, lane by lane.
inline Lanes median_of_seven(std::array<Lanes, 7> v) {
  const auto sort = [&](int i, int j) {
    const Lanes low = v[i] < v[j] ? v[i] : v[j];
    v[j] = v[i] < v[j] ? v[j] : v[i], v[i] = low;
  };
  for (const auto& [i, j] : {std::pair(0, 5),
                             {0, 3},
                             {1, 6},
                             {2, 4},
                             {0, 1},
                             {3, 5},
                             {2, 6},
                             {2, 3},
                             {3, 6},
                             {4, 5},
                             {1, 4},
                             {1, 3},
                             {3, 4}})
    sort(i, j);
  return v[3];
}

inline bool any(LaneMask mask) {
  std::uint64_t parts[kLanes / 2];
  std::memcpy(parts, &mask, sizeof mask);
  return (parts[0] | parts[1] | parts[2] | parts[3]) != 0;
}
inline int count_of(LaneMask mask) {
  int count = 0;
  for (int i = 0; i < kLanes; ++i) count -= mask[i];
  return count;
}

// `count` values of memory, zeros behind them.
template <class Vector, class T>
[[gnu::always_inline]] inline Vector load(const T* from, int count = kLanes) {
  static_assert(sizeof(Vector) == kLanes * sizeof(T));
  using Unaligned [[gnu::aligned(1), gnu::may_alias]] = Vector;  // a memcpy goes by way of other registers
  if (count == kLanes) return *reinterpret_cast<const Unaligned*>(from);
  Vector v{};
  std::memcpy(&v, from, count * sizeof(T));
  return v;
}
template <class Vector, class T>
[[gnu::always_inline]] inline void store(Vector v, T* to, int count = kLanes) {
  static_assert(sizeof(Vector) == kLanes * sizeof(T));
  if (count == kLanes)
    std::memcpy(to, &v, sizeof v);
  else
    std::memcpy(to, &v, count * sizeof(T));
}

// Bytes as lanes, and lanes (0 to 255) as bytes. GCC 12 takes vectors of eight bytes apart.
[[gnu::always_inline]] inline LaneMask load_bytes(const std::uint8_t* from, int count = kLanes) {
#ifdef __AVX2__
  if (count == kLanes)
    return std::bit_cast<LaneMask>(_mm256_cvtepu8_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(from))));
#endif
  LaneMask v{};
  for (int i = 0; i < count; ++i) v[i] = from[i];
  return v;
}
[[gnu::always_inline]] inline void store_bytes(LaneMask v, std::uint8_t* to, int count = kLanes) {
#ifdef __AVX2__
  if (count == kLanes) {
    const __m256i lowest = _mm256_shuffle_epi8(std::bit_cast<__m256i>(v), _mm256_set1_epi32(0x0c080400));
    const __m128i low = _mm256_castsi256_si128(lowest), high = _mm256_extracti128_si256(lowest, 1);
    _mm_storel_epi64(reinterpret_cast<__m128i*>(to), _mm_unpacklo_epi32(low, high));
    return;
  }
#endif
  for (int i = 0; i < count; ++i) to[i] = static_cast<std::uint8_t>(v[i]);
}

// Calls body(x, count) for all of a row, kLanes at a time; `count` is a constant but for what is left at the end.
template <class Body>
[[gnu::always_inline]] inline void for_lanes(int width, Body&& body) {
  int x = 0;
  for (; x + kLanes <= width; x += kLanes) body(x, std::integral_constant<int, kLanes>());
  if (x < width) body(x, width - x);
}

}  // namespace countershade
