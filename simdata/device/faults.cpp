#include "simdata/device/faults.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>

#include "calib/base/random.h"
#include "calib/file/nearest.h"
#include "simdata/device/blur.h"
#include "simdata/device/sensor.h"

namespace countershade::simdata {

namespace {

// Bilinear, zero outside.
float sample(const Image& image, double x, double y, int c) {
  const int x0 = static_cast<int>(std::floor(x)), y0 = static_cast<int>(std::floor(y));
  const double fx = x - x0, fy = y - y0;
  double sum = 0;
  for (int j = 0; j < 2; ++j)
    for (int i = 0; i < 2; ++i)
      if (x0 + i >= 0 && y0 + j >= 0 && x0 + i < image.width() && y0 + j < image.height())
        sum += (i ? fx : 1 - fx) * (j ? fy : 1 - fy) * image.at(x0 + i, y0 + j, c);
  return static_cast<float>(sum);
}

template <class Raster, class Value>
void for_pixels(Raster& raster, Value value) {
  for (int y = 0; y < raster.height(); ++y)
    for (int x = 0; x < raster.width(); ++x)
      for (int c = 0; c < raster.channels(); ++c) raster.at(x, y, c) = value(x, y, c);
}

// Pixel (x, y) shows what stood at (scale x + dx, scale y + dy); linear between pixels, black outside.
Picture resampled(const Picture& picture, double scale, double dx, double dy) {
  Image from(picture.width(), picture.height(), picture.channels());
  std::copy(picture.data().begin(), picture.data().end(), from.data().begin());
  Picture out = picture;
  for_pixels(out, [&](int x, int y, int c) {
    return static_cast<std::uint16_t>(std::lround(sample(from, scale * x + dx, scale * y + dy, c)));
  });
  return out;
}

Picture mapped(Picture picture, const std::array<std::vector<std::uint16_t>, 3>& tables) {
  for_pixels(picture, [&](int x, int y, int c) { return tables[c][picture.at(x, y, c)]; });
  return picture;
}

template <class Curve>
std::vector<std::uint16_t> table(Curve curve) {
  std::vector<std::uint16_t> values(65536);
  for (int i = 0; i < 65536; ++i)
    values[i] = static_cast<std::uint16_t>(std::lround(65535 * std::clamp(curve(i / 65535.0), 0.0, 1.0)));
  return values;
}

void multiply(Image& light, double factor) {
  for (float& v : light.data()) v *= static_cast<float>(factor);
}
double mean(const Image& image) {
  double sum = 0;
  for (float v : image.data()) sum += v;
  return image.data().empty() ? 0 : sum / static_cast<double>(image.data().size());
}

}  // namespace

const std::vector<FaultKind>& fault_kinds() {
  static const std::vector<FaultKind> kinds = {
      {"stale-frame", "on/off", 1, 1, 1, 30, "one photo is taken before the new picture is shown"},
      {"duplicated-frame", "on/off", 1, 1, 1, 30, "the driver hands over the former photo once more"},
      {"dropped-frame", "photos", 1, 1, 100, 30, "photos are lost on the way; the counter jumps"},
      {"wrong-display", "on/off", 1, 1, 1, 0, "the projectors' cables are swapped"},
      {"night-light", "share of blue", 0.4, 0.01, 1, 0, "the desktop takes blue (and some green) out in the evening"},
      {"scaled-desktop", "factor", 1.25, 1.01, 4, 0, "the desktop magnifies what it is sent"},
      {"gamma-wrong", "exponent", 1.15, 0.3, 3, 0, "the projector's picture mode bends its response"},
      {"projector-nudged", "projector px", 3, 0.01, 200, 80, "somebody touches the projectors: pictures shift"},
      {"warm-up", "share", 0.1, 0.001, 0.9, 0, "the lamps lose that much light, half of it within 35 photos"},
      {"exposure-jitter", "share", 0.05, 0.001, 1, 0, "the camera's shutter: brightness differs from photo to photo"},
      {"lamp-switched-on", "full scale", 0.08, 0.001, 1, 60, "light from elsewhere, uneven over the room"},
      {"person-walks-in", "share of width", 0.12, 0.01, 1, 50, "somebody crosses the picture during 15 photos"},
      {"person-stays", "share of width", 0.12, 0.01, 1, 50, "somebody comes, and stays where he stands"},
      {"camera-bumped", "mm", 6, 0.01, 1000, 70, "somebody pushes the tripod aside"},
      {"camera-turned", "degrees", 0.1, 0.0001, 30, 70, "somebody touches the camera: it looks elsewhere"},
      {"camera-shaken", "degrees rms", 0.02, 0.0001, 5, 0, "the tripod trembles: every photo looks elsewhere"},
      {"camera-drifts", "degrees per photo", 0.002, 0.00001, 1, 0, "the camera's mount gives way, evenly"},
      {"defocus", "camera px, sigma", 2, 0.1, 50, 0, "the camera's lens is out of focus"},
      {"glare", "share of the mean", 0.05, 0.0001, 1, 0, "veiling glare: the mean light of each channel lies over it"},
      {"dust", "specks", 25, 1, 10000, 0, "dust on the sensor: dark spots that stay"},
      {"auto-exposure", "strength", 0.7, 0.01, 1, 0, "the camera adapts its exposure to every photo"},
      {"saturated", "factor", 1.6, 1.01, 100, 0, "the exposure is too long"},
      {"underexposed", "factor", 0.08, 0.0001, 0.99, 0, "the exposure is too short"},
      {"missing-packets", "share of rows", 0.08, 0.001, 1, 40,
       "the network loses packets: bands of one photo are black"},
  };
  return kinds;
}

Result<std::vector<Fault>> parse_faults(const std::string& text) {
  std::vector<Fault> faults;
  std::vector<std::string> names;
  for (const FaultKind& kind : fault_kinds()) names.emplace_back(kind.name);
  for (std::size_t start = 0; start <= text.size();) {
    const std::size_t end = std::min(text.find(',', start), text.size());
    const std::string item = text.substr(start, end - start);
    start = end + 1;
    const std::size_t equals = item.find('='), sign = item.find('@');
    const std::string name = item.substr(0, std::min(equals, sign));
    const auto kind =
        std::find_if(fault_kinds().begin(), fault_kinds().end(), [&](const FaultKind& k) { return name == k.name; });
    if (kind == fault_kinds().end())
      return error(ErrorCode::kBadValue,
                   "--faults: there is no fault '{}'; the nearest is '{}' (`--faults list` shows them all)", name,
                   nearest(name, names));
    Fault fault{&*kind, kind->value, static_cast<std::uint64_t>(kind->photo)};
    const auto number = [&](const std::string& digits, auto& value) {
      const auto [rest, code] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
      return code == std::errc() && rest == digits.data() + digits.size();
    };
    if (sign != std::string::npos && !number(item.substr(sign + 1), fault.photo))
      return error(ErrorCode::kBadValue, "--faults: '{}': the photo after '@' must be a whole number, 0 or more", item);
    if (equals != std::string::npos && equals < sign &&
        !number(item.substr(equals + 1, sign == std::string::npos ? sign : sign - equals - 1), fault.value))
      return error(ErrorCode::kBadValue, "--faults: '{}': the value after '=' must be a number", item);
    if (!(fault.value >= kind->low && fault.value <= kind->high))
      return error(ErrorCode::kBadValue, "--faults: {}={} is out of range; {} to {} ({})", name, fault.value, kind->low,
                   kind->high, kind->unit);
    if (std::any_of(faults.begin(), faults.end(),
                    [&](const Fault& f) { return f.kind == fault.kind && f.photo == fault.photo; }))
      return error(ErrorCode::kBadValue, "--faults: '{}' is named twice for photo {}; keep one", name, fault.photo);
    faults.push_back(fault);
  }
  return faults;
}

double Faults::value(std::uint64_t photo, const char* name) const {
  double sum = 0;
  for (const Fault& f : faults_)
    if (photo >= f.photo && std::string_view(f.kind->name) == name) sum = f.value;
  return sum;
}

std::uint64_t Faults::acted(std::uint64_t photo, const char* name) const {
  std::uint64_t photos = 0;
  for (const Fault& f : faults_)
    if (photo >= f.photo && std::string_view(f.kind->name) == name) photos = std::max(photos, photo - f.photo + 1);
  return photos;
}

bool Faults::at(std::uint64_t photo, const char* name) const {
  return std::any_of(faults_.begin(), faults_.end(),
                     [&](const Fault& f) { return photo == f.photo && std::string_view(f.kind->name) == name; });
}

std::uint64_t Faults::acting(std::uint64_t photo) const {
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < faults_.size(); ++i) {
    if (photo < faults_[i].photo) continue;
    const std::string_view name = faults_[i].kind->name;
    bits = mix(bits ^ (i + 1));
    if (name == "camera-shaken" || name == "camera-drifts") bits = mix(bits ^ mix(photo));  // other in every photo
  }
  return bits;
}

int Faults::dropped(std::uint64_t photo) const {
  return at(photo, "dropped-frame") ? static_cast<int>(value(photo, "dropped-frame")) : 0;
}

std::optional<Pose> Faults::camera_move(std::uint64_t photo) const {
  const double mm = value(photo, "camera-bumped"), turned = value(photo, "camera-turned");
  const double shaken = value(photo, "camera-shaken"), drifts = value(photo, "camera-drifts");
  if (mm == 0 && turned == 0 && shaken == 0 && drifts == 0) return std::nullopt;
  // To the right and a little down, about axes that are neither upright nor level.
  Eigen::Vector3d degrees = turned * Eigen::Vector3d(0.6, 0.8, 0);
  Random random(mix(seed_ ^ hash_name("camera-shaken")) ^ mix(photo));
  const double nods = random.normal(), turns = random.normal();
  degrees += shaken * Eigen::Vector3d(0.6 * nods, 0.8 * turns, 0);
  if (drifts > 0)
    degrees += drifts * static_cast<double>(acted(photo, "camera-drifts")) * Eigen::Vector3d(0.8, -0.6, 0);
  return Pose{rotation_from_vector(std::numbers::pi / 180 * degrees), -1e-3 * mm * Eigen::Vector3d(0.8, 0.6, 0)};
}

std::vector<Picture> Faults::emitted(std::vector<Picture> pictures, std::uint64_t photo) const {
  if (value(photo, "wrong-display") > 0 && pictures.size() > 1 &&
      pictures[0].same_size(pictures[1].width(), pictures[1].height()))
    std::rotate(pictures.begin(), pictures.begin() + 1, pictures.end());
  const double night = value(photo, "night-light"), magnified = value(photo, "scaled-desktop"),
               exponent = value(photo, "gamma-wrong"), nudge = value(photo, "projector-nudged");
  for (Picture& picture : pictures) {
    if (picture.empty()) continue;
    if (night > 0)
      picture = mapped(std::move(picture),
                       {table([](double v) { return v; }), table([&](double v) { return v * (1 - 0.4 * night); }),
                        table([&](double v) { return v * (1 - night); })});
    if (exponent > 0) {
      const std::vector<std::uint16_t> bent = table([&](double v) { return std::pow(v, exponent); });
      picture = mapped(std::move(picture), {bent, bent, bent});
    }
    if (magnified > 0) picture = resampled(picture, 1 / magnified, 0, 0);
    if (nudge > 0) {  // it is light that shifts, not what is sent: of an exponent of 2.2
      const auto bent = [&](double exponent) {
        const std::vector<std::uint16_t> curve = table([&](double v) { return std::pow(v, exponent); });
        picture = mapped(std::move(picture), {curve, curve, curve});
      };
      bent(2.2);
      picture = resampled(picture, 1, -0.8 * nudge, 0.6 * nudge);
      bent(1 / 2.2);
    }
  }
  return pictures;
}

void Faults::light(Image& light, std::uint64_t photo) const {
  if (const double v = value(photo, "warm-up"); v > 0) multiply(light, 1 - v * (1 - std::exp2(-(photo / 35.0))));
  if (const double v = value(photo, "exposure-jitter"); v > 0) {
    Random random(mix(seed_ ^ hash_name("exposure-jitter")) ^ photo);
    multiply(light, 1 + v * std::sin(2 * std::numbers::pi * random.uniform()));
  }
  if (const double v = value(photo, "lamp-switched-on"); v > 0)
    for_pixels(light, [&](int x, int y, int c) {
      const double u = static_cast<double>(x) / light.width(), w = static_cast<double>(y) / light.height();
      return light.at(x, y, c) + static_cast<float>(v * (0.6 + 0.6 * u - 0.3 * w) * (1 - 0.15 * c));
    });
  const auto stand = [&](double centre, double width) {
    for_pixels(light, [&](int x, int y, int c) {
      const double u = (static_cast<double>(x) / light.width() - centre) / (0.5 * width),
                   w = (static_cast<double>(y) / light.height() - 0.75) / 0.55;
      return u * u + w * w < 1 ? 0.08f * light.at(x, y, c) : light.at(x, y, c);
    });
  };
  if (const double v = value(photo, "person-walks-in"); v > 0)
    for (const Fault& f : faults_)
      if (std::string_view(f.kind->name) == "person-walks-in" && photo < f.photo + 15)
        stand((static_cast<double>(photo - f.photo) + 0.5) / 15, v);
  if (const double v = value(photo, "person-stays"); v > 0) stand(0.35, v);
  if (const double v = value(photo, "defocus"); v > 0) light = blurred(light, v);
  if (const double v = value(photo, "glare"); v > 0) add_glare(light, v);
  const int specks = static_cast<int>(value(photo, "dust"));
  Random random(mix(seed_ ^ hash_name("dust")));
  for (int i = 0; i < specks; ++i) {
    const double x0 = random.uniform() * light.width(), y0 = random.uniform() * light.height(),
                 radius = (0.002 + 0.006 * random.uniform()) * light.width();
    for (int y = std::max(0, static_cast<int>(y0 - 2 * radius)); y < std::min<double>(light.height(), y0 + 2 * radius);
         ++y)
      for (int x = std::max(0, static_cast<int>(x0 - 2 * radius)); x < std::min<double>(light.width(), x0 + 2 * radius);
           ++x) {
        const double r2 = ((x - x0) * (x - x0) + (y - y0) * (y - y0)) / (radius * radius);
        for (int c = 0; c < light.channels(); ++c) light.at(x, y, c) *= static_cast<float>(1 - 0.6 * std::exp(-r2));
      }
  }
}

double Faults::exposure_factor(const Image& light, std::uint64_t photo) const {
  double factor = 1;
  if (const double v = value(photo, "auto-exposure"); v > 0)  // towards a mean of 18 % of full scale
    factor *= std::pow(0.18 / std::max(mean(light), 1e-3), v);
  for (const char* name : {"saturated", "underexposed"})
    if (const double v = value(photo, name); v > 0) factor *= v;
  return factor;
}

void Faults::arrived(capture::Exposure& exposure, std::uint64_t photo) const {
  if (!at(photo, "missing-packets")) return;
  Image& values = exposure.values;
  Random random(mix(seed_ ^ hash_name("missing-packets")) ^ photo);
  const int lost = std::max(1, static_cast<int>(value(photo, "missing-packets") * values.height() / 4));
  for (int band = 0; band < 4; ++band) {
    const int start = static_cast<int>(random.uniform() * std::max(1, values.height() - lost));
    for (int y = start; y < std::min(start + lost, values.height()); ++y)
      std::fill(values.row(y), values.row(y) + static_cast<std::ptrdiff_t>(values.width()) * values.channels(), 0.f);
  }
}

}  // namespace countershade::simdata
