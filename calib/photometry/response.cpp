#include "calib/photometry/response.h"

#include <algorithm>
#include <charconv>
#include <cmath>

namespace countershade {

Result<Response> Response::parse(const std::string& text) {
  Response response;
  response.text_ = text;
  if (text == "linear") return response;
  if (text == "srgb") {
    response.kind_ = Kind::kSrgb;
    return response;
  }
  if (text.rfind("gamma:", 0) == 0) {
    const char* end = text.data() + text.size();
    const auto [stop, code] = std::from_chars(text.data() + 6, end, response.gamma_);
    if (code == std::errc() && stop == end && response.gamma_ >= 0.2 && response.gamma_ <= 5) {
      response.kind_ = Kind::kGamma;
      return response;
    }
    return error(ErrorCode::kBadValue, "response '{}': the exponent must be a number from 0.2 to 5, as in gamma:2.2",
                 text);
  }
  return error(ErrorCode::kBadValue, "response '{}' is not known; use linear, srgb or gamma:G (as in gamma:2.2)", text);
}

// sRGB: IEC 61966-2-1.
double Response::decode(double encoded) const {
  const double v = std::clamp(encoded, 0.0, 1.0);
  if (kind_ == Kind::kGamma) return std::pow(v, gamma_);
  if (kind_ == Kind::kSrgb) return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
  return v;
}

double Response::encode(double linear) const {
  const double v = std::clamp(linear, 0.0, 1.0);
  if (kind_ == Kind::kGamma) return std::pow(v, 1 / gamma_);
  if (kind_ == Kind::kSrgb) return v <= 0.04045 / 12.92 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055;
  return v;
}

std::vector<float> Response::decode_table(int size) const {
  CS_CHECK(size >= 2, "a table has both ends");
  std::vector<float> table(size);
  for (int i = 0; i < size; ++i) table[i] = static_cast<float>(decode(static_cast<double>(i) / (size - 1)));
  return table;
}

}  // namespace countershade
