#include "tools/report/picture.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>

#include "tools/report/colour.h"
#include "tools/report/metrics.h"
#include "tools/report/plot.h"

namespace countershade::tools {

namespace {

constexpr Rgb kNotShown = {0.33, 0.33, 0.34};

std::string css_colour(const Rgb& rgb) {
  return fmt::format("rgb({},{},{})", std::lround(255 * rgb[0]), std::lround(255 * rgb[1]), std::lround(255 * rgb[2]));
}

void put(Image& out, std::size_t pixel, const Rgb& rgb) {
  for (int c = 0; c < 3; ++c) out.data()[3 * pixel + c] = static_cast<float>(255 * rgb[c]);
}

// 255 sRGB of 0..1 at equal steps: a picture has millions of values. Nearest entry: off by .05 grey levels at most.
std::vector<float> srgb_table() {
  std::vector<float> table(65536);
  for (std::size_t i = 0; i < table.size(); ++i)
    table[i] = static_cast<float>(255 * srgb_encode(static_cast<double>(i) / 65535));
  return table;
}

// The diverging scale at equal steps from -1 to 1, finer than 8 bits can show.
std::vector<Rgb> diverging_table() {
  std::vector<Rgb> table(2001);
  for (std::size_t i = 0; i < table.size(); ++i) table[i] = diverging(static_cast<double>(i) / 1000 - 1);
  return table;
}

int reduction(int width, int max_width) {
  return std::max(1, (width + max_width - 1) / max_width);
}

}  // namespace

Image as_seen(const Image& light, double white) {
  const std::vector<float> table = srgb_table();
  Image out(light.width(), light.height(), 3);
  const int channels = light.channels();
  const float scale = static_cast<float>(65535 / white);
  for (std::size_t i = 0; i < light.pixels(); ++i)
    for (int c = 0; c < 3; ++c) {
      const float value = light.data()[i * channels + (channels == 3 ? c : 0)];
      const bool known = std::isfinite(value);
      out.data()[3 * i + c] = known ? table[std::lround(std::clamp(value * scale, 0.0f, 65535.0f))] : 127.5f;
    }
  return out;
}

Image signed_difference(const Image& a, const Image& b, const Mask& shown, double white, double reach_percent) {
  CS_CHECK(b.same_size(a.width(), a.height()) && b.channels() == a.channels(), "images of one shape");
  CS_CHECK(shown.same_size(a.width(), a.height()), "mask of the images' size");
  const std::vector<Rgb> scale = diverging_table();
  Image out(a.width(), a.height(), 3);
  const int channels = a.channels();
  for (std::size_t i = 0; i < a.pixels(); ++i) {
    double farthest = 0;
    for (int c = 0; c < channels; ++c) {
      const double d = static_cast<double>(a.data()[i * channels + c]) - b.data()[i * channels + c];
      if (!(std::abs(d) <= std::abs(farthest))) farthest = d;
      if (std::isnan(d)) break;
    }
    const bool known = shown.data()[i] && std::isfinite(farthest);
    const double position = known ? std::clamp(100 * farthest / white / reach_percent, -1.0, 1.0) : 0;
    put(out, i, known ? scale[std::lround(1000 * (position + 1))] : kNotShown);
  }
  return out;
}

std::string difference_legend(double reach) {
  constexpr int kSteps = 64;
  constexpr double kLeft = 24, kWidth = 312;
  std::string out = "<svg viewBox='0 0 360 40' role='img' class='legend'>";
  for (int i = 0; i < kSteps; ++i)
    out += fmt::format("<rect x='{:.2f}' y='2' width='{:.2f}' height='14' fill='{}'/>", kLeft + kWidth * i / kSteps,
                       kWidth / kSteps + 0.6, css_colour(diverging((2 * i + 1.0) / kSteps - 1)));
  for (double share : {-1.0, -0.5, 0.0, 0.5, 1.0}) {
    const double x = kLeft + kWidth * (share + 1) / 2;
    out += fmt::format("<line x1='{0:.1f}' y1='16' x2='{0:.1f}' y2='21' class='frame'/>", x);
    out += fmt::format("<text x='{:.1f}' y='34' class='tick' text-anchor='middle'>{}{:g} %</text>", x,
                       share < 0   ? "\u2212"
                       : share > 0 ? "+"
                                   : "",
                       std::abs(share) * reach);
  }
  return out + "</svg>\n";
}

Image reduced_to(const Image& image, int max_width) {
  const int factor = reduction(image.width(), max_width);
  if (factor == 1) return image;
  return masked_box_reduce(image, Mask(image.width(), image.height(), 1, 1), factor).value;
}

Mask reduced_to(const Mask& mask, int max_width) {
  const int factor = reduction(mask.width(), max_width);
  Mask out(mask.width() / factor, mask.height() / factor, 1);
  for (int y = 0; y < out.height(); ++y)
    for (int x = 0; x < out.width(); ++x) {
      int count = 0;
      for (int k = 0; k < factor * factor; ++k) count += mask.at(x * factor + k % factor, y * factor + k / factor) != 0;
      out.at(x, y) = 2 * count >= factor * factor;
    }
  return out;
}

Result<std::string> png_bytes(const Image& values) {
  CS_CHECK(values.channels() == 3, "RGB");
  cv::Mat pixels(values.height(), values.width(), CV_8UC3);
  for (int y = 0; y < values.height(); ++y)
    for (int x = 0; x < values.width(); ++x)
      for (int c = 0; c < 3; ++c)  // OpenCV stores BGR
        pixels.at<cv::Vec3b>(y, x)[2 - c] =
            static_cast<unsigned char>(std::lround(std::clamp(values.at(x, y, c), 0.0f, 255.0f)));
  std::vector<unsigned char> bytes;
  try {
    if (!cv::imencode(".png", pixels, bytes, {cv::IMWRITE_PNG_COMPRESSION, 2}))
      return error(ErrorCode::kIo, "a picture of {} x {} pixels cannot be encoded as PNG", values.width(),
                   values.height());
  } catch (const cv::Exception& reason) {
    return error(ErrorCode::kIo, "a picture of {} x {} pixels cannot be encoded as PNG: {}", values.width(),
                 values.height(), reason.what());
  }
  return std::string(bytes.begin(), bytes.end());
}

std::string data_uri(const std::string& png) {
  static constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out = "data:image/png;base64,";
  out.reserve(out.size() + png.size() * 4 / 3 + 4);
  for (std::size_t i = 0; i < png.size(); i += 3) {
    unsigned group = 0;
    for (std::size_t k = i; k < i + 3; ++k)
      group = group << 8 | (k < png.size() ? static_cast<unsigned char>(png[k]) : 0);
    for (std::size_t k = 0; k < 4; ++k) out += i + k > png.size() ? '=' : kDigits[group >> (18 - 6 * k) & 63];
  }
  return out;
}

}  // namespace countershade::tools
