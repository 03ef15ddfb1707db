// How correspondences are stored and looked at.
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "capture/pattern/decode.h"

namespace countershade::capture {

const std::map<int, std::string>& reason_names() {
  static const std::map<int, std::string> kNames = {{0, "accepted"},
                                                    {1, "dark"},
                                                    {2, "saturated"},
                                                    {3, "uncertain bit"},
                                                    {4, "inconsistent"},
                                                    {5, "isolated"},
                                                    {6, "no code"},
                                                    {7, "lit indirectly only"},
                                                    {8, "phase inconsistent"},
                                                    {9, "epipolar inconsistent"},
                                                    {10, "mixed pixel"}};
  return kNames;
}

std::map<std::string, double> Correspondence::rejected() const {
  std::array<std::size_t, 256> counts{};
  for (const std::uint8_t why : reason.data()) ++counts[why];
  std::map<std::string, double> shares;
  for (const auto& [number, name] : reason_names()) {
    const auto why = static_cast<Reason>(number);
    const bool is_lit = why != Reason::kAccepted && why != Reason::kDark && why != Reason::kIndirect;
    if (is_lit && counts[number] > 0) shares[name] = static_cast<double>(counts[number]) / static_cast<double>(lit);
  }
  return shares;
}

double Correspondence::expected_wrong() const {
  double sum = 0;
  for (std::size_t i = 0; i < reason.data().size(); ++i)
    if (reason.data()[i] == static_cast<std::uint8_t>(Reason::kAccepted))
      sum += std::erfc(1 / (std::numbers::sqrt2 * sigma.data()[i]));
  return accepted ? sum / static_cast<double>(accepted) : 0;
}

Result<void> write_correspondence(const std::filesystem::path& folder, const Correspondence& c) {
  Image reason(c.reason.width(), c.reason.height(), 1);
  for (std::size_t i = 0; i < reason.data().size(); ++i) reason.data()[i] = c.reason.data()[i];
  CS_TRY_VOID(write_exr(folder / (c.camera + "-" + c.projector + ".exr"),
                        {{"x", &c.x}, {"y", &c.y}, {"sigma", &c.sigma}, {"reason", &reason}}));
  nlohmann::json names = nlohmann::json::object();
  for (const auto& [number, name] : reason_names()) names[std::to_string(number)] = name;
  return write_atomically(folder / "reasons.json", names.dump(1) + "\n");
}

Result<void> write_reason_picture(const std::filesystem::path& path, const Correspondence& c) {
  // Dark is black, indirect light dark grey; what should have decoded and did not is loud.
  static constexpr float kColours[11][3] = {{0, 0, 0},     {0, 0, 0},     {255, 255, 255}, {255, 150, 0},
                                            {255, 0, 60},  {255, 0, 255}, {120, 80, 40},   {45, 45, 50},
                                            {0, 200, 255}, {255, 255, 0}, {0, 255, 100}};
  Image picture(c.reason.width(), c.reason.height(), 3);
  for (std::size_t i = 0; i < picture.pixels(); ++i) {
    const int reason = c.reason.data()[i];
    float* rgb = picture.data().data() + 3 * i;
    for (int k = 0; k < 3; ++k) rgb[k] = kColours[reason][k];
    if (reason != 0) continue;
    rgb[0] = 20;
    rgb[1] = std::isfinite(c.x.data()[i]) ? 40 + 120 * c.x.data()[i] / std::max(1, c.projector_resolution[0]) : 40;
    rgb[2] = std::isfinite(c.y.data()[i]) ? 40 + 120 * c.y.data()[i] / std::max(1, c.projector_resolution[1]) : 40;
  }
  return write_png8(path, picture);
}

}  // namespace countershade::capture
