#include "solver/runtime/matrix.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace countershade::solver {
namespace {

constexpr int kGroupRows = 128;  // of a workgroup of gather.comp

// Rows [row, row + rows) of F as gather.comp reads them, times scale: words of one pair of columns side by side.
template <class Word, class Pack>
std::vector<Word> pack_rows(const Eigen::MatrixXf& F, int row, int rows, int stride, const RowBand& band, Pack pack) {
  std::vector<int> columns;
  for (int j = 0; j < F.cols(); ++j)
    if (j < band.skip || j >= band.skip + band.skipped) columns.push_back(j);
  const std::size_t pairs = (columns.size() + 1) / 2;
  std::vector<Word> words(pairs * stride, pack(0.f, 0.f));
  for (std::size_t p = 0; p < pairs; ++p)
    for (int i = 0; i < rows; ++i) {
      const float second = 2 * p + 1 < columns.size() ? F(row + i, columns[2 * p + 1]) : 0.f;
      words[p * stride + i] = pack(F(row + i, columns[2 * p]), second);
    }
  return words;
}

std::uint16_t half_bits(float value) {
  return Eigen::numext::bit_cast<std::uint16_t>(Eigen::half(value));
}

// Power of two that brings the largest entry near 2^14, well inside the range of half floats.
float half_scale(const Eigen::MatrixXf& F) {
  const float largest = F.size() > 0 ? F.cwiseAbs().maxCoeff() : 0.f;
  return largest > 0 ? std::exp2(14.f - std::ceil(std::log2(largest))) : 1.f;
}

}  // namespace

std::vector<float> as_vec4(const Radiosity& values) {
  std::vector<float> out(4 * static_cast<std::size_t>(values.rows()), 0.f);
  for (Eigen::Index i = 0; i < values.rows(); ++i)
    for (int c = 0; c < 3; ++c) out[4 * static_cast<std::size_t>(i) + c] = values(i, c);
  return out;
}

Radiosity from_vec4(const std::vector<float>& values) {
  Radiosity out(static_cast<Eigen::Index>(values.size() / 4), 3);
  for (Eigen::Index i = 0; i < out.rows(); ++i)
    for (int c = 0; c < 3; ++c) out(i, c) = values[4 * static_cast<std::size_t>(i) + c];
  return out;
}

Result<GlMatrix> GlMatrix::make(const std::string& what, const Eigen::MatrixXf& F, const Radiosity& k,
                                const std::vector<RowBand>& bands, Precision precision, std::size_t block_bytes) {
  const bool half = precision == Precision::kHalf;
  const std::size_t pair_bytes = half ? 4 : 8;
  const float scale = half ? half_scale(F) : 1.f;
  GlMatrix matrix;
  matrix.columns_ = static_cast<int>(F.cols());
  matrix.unscale_ = 1 / scale;
  CS_TRY(matrix.gain_, Buffer::of("the indirect gain", as_vec4(k)));
  for (const RowBand& band : bands) {
    const int pairs = (matrix.columns_ - band.skipped + 1) / 2;
    const std::size_t group_bytes = std::max<std::size_t>(1, pairs) * pair_bytes * kGroupRows;
    const int most = static_cast<int>(std::min<std::size_t>(block_bytes / group_bytes, 1 << 16)) * kGroupRows;
    if (most == 0)
      return error(ErrorCode::kDevice, "{}: {} columns do not fit one GL buffer: use the CPU or fewer patches", what,
                   F.cols());
    for (int row = band.row; row < band.row + band.rows; row += most) {
      const int rows = std::min(most, band.row + band.rows - row);
      const int stride = (rows + kGroupRows - 1) / kGroupRows * kGroupRows;
      Chunk chunk{{}, row, rows, stride, pairs, band.skip, band.skipped};
      if (half) {
        const auto pack = [&](float a, float b) -> std::uint32_t {
          return half_bits(a * scale) | static_cast<std::uint32_t>(half_bits(b * scale)) << 16;
        };
        CS_TRY(chunk.words, Buffer::of(what, pack_rows<std::uint32_t>(F, row, rows, stride, band, pack)));
      } else {
        const auto pack = [](float a, float b) { return std::array<float, 2>{a, b}; };
        const auto words = pack_rows<std::array<float, 2>>(F, row, rows, stride, band, pack);
        CS_TRY(chunk.words, Buffer::of(what, words));
      }
      matrix.chunks_.push_back(std::move(chunk));
    }
  }
  return matrix;
}

void GlMatrix::run(const Program& gather, const GatherCall& call) const {
  call.input->bind_storage(1);
  call.output->bind_storage(2);
  (call.base != nullptr ? call.base : call.input)->bind_storage(3);
  gain_.bind_storage(6);
  gather.set(6, columns_);
  gather.set(7, unscale_);
  gather.set(8, static_cast<int>(call.mode));
  gather.set(9, call.iteration);
  gather.set(10, call.tolerance);
  gather.set(11, call.invisible);
  for (const Chunk& chunk : chunks_) {
    chunk.words.bind_storage(0);
    gather.set(0, chunk.row);
    gather.set(1, chunk.rows);
    gather.set(2, chunk.stride);
    gather.set(3, chunk.pairs);
    gather.set(4, chunk.skip);
    gather.set(5, chunk.skipped);
    gather.dispatch(chunk.stride / kGroupRows);
  }
  storage_barrier();
}

}  // namespace countershade::solver
