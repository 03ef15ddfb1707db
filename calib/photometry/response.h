// Transfer curves between encoded values (0..1, as sent or stored) and linear light (0..1).
#pragma once

#include <string>
#include <vector>

#include "calib/base/result.h"

namespace countershade {

class Response {
 public:
  Response() = default;  // linear
  // "linear", "srgb" or "gamma:G" with G in [0.2, 5]. Errors: kBadValue. ("measured" is resolved by the caller.)
  static Result<Response> parse(const std::string& text);
  const std::string& text() const { return text_; }
  // Encoded -> linear and back; arguments outside 0..1 are clamped.
  double decode(double encoded) const;
  double encode(double linear) const;
  // decode at i / (size - 1), for look-ups.
  std::vector<float> decode_table(int size) const;

 private:
  std::string text_ = "linear";
  enum class Kind { kLinear, kSrgb, kGamma } kind_ = Kind::kLinear;
  double gamma_ = 1;
};

// What a projector emits as a fraction of its white: light = black_level + (1 - black_level) decode(encoded).
struct ProjectorResponse {
  Response curve;
  double black_level = 0;
  double light(double encoded) const { return black_level + (1 - black_level) * curve.decode(encoded); }
  // Encoded value for an amount of light; clamped to what the projector can do.
  double encoded(double light) const { return curve.encode((light - black_level) / (1 - black_level)); }
};

}  // namespace countershade
