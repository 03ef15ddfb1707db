#include "tools/job/check/identification.h"

#include <algorithm>
#include <chrono>
#include <opencv2/imgproc.hpp>
#include <thread>

namespace countershade::tools {

namespace {

constexpr int kSteps = 8;  // of 4 in 255, at each end

void fill(cv::Mat& picture, const cv::Rect& where, int value) {
  picture(where & cv::Rect(0, 0, picture.cols, picture.rows)).setTo(cv::Scalar::all(value));
}

// Fields of one height side by side: single pixels, single columns, steps from black, steps to white.
void draw_fields(cv::Mat& picture, int top, int side) {
  const int left = (picture.cols - 4 * side) / 2;
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) {
      const int column = left + x, row = top + y;
      picture.at<std::uint8_t>(row, column) = (x + y) % 2 ? 255 : 0;
      picture.at<std::uint8_t>(row, column + side) = x % 2 ? 255 : 0;
      const int step = x * kSteps / side;
      picture.at<std::uint8_t>(row, column + 2 * side) = static_cast<std::uint8_t>(4 * step);
      picture.at<std::uint8_t>(row, column + 3 * side) = static_cast<std::uint8_t>(255 - 4 * step);
    }
}

void draw_text(cv::Mat& picture, const std::vector<std::string>& text, int height) {
  const auto font = cv::FONT_HERSHEY_SIMPLEX;
  const double line = static_cast<double>(height) / static_cast<double>(std::max<std::size_t>(1, text.size()));
  for (std::size_t i = 0; i < text.size(); ++i) {
    int base = 0;
    const cv::Size one = cv::getTextSize(text[i], font, 1, 2, &base);
    const double scale = std::min(0.9 * picture.cols / std::max(1, one.width), 0.5 * line / std::max(1, one.height));
    const int x = static_cast<int>((picture.cols - scale * one.width) / 2);
    cv::putText(picture, text[i], {x, static_cast<int>(line * (static_cast<double>(i) + 0.75))}, font, scale,
                cv::Scalar::all(255), std::max(1, static_cast<int>(2 * scale)), cv::LINE_AA);
  }
}

}  // namespace

Picture identification_picture(int width, int height, const std::vector<std::string>& text) {
  cv::Mat grey(height, width, CV_8U, cv::Scalar::all(0));
  fill(grey, {0, 0, width, 1}, 255), fill(grey, {0, height - 1, width, 1}, 255);
  fill(grey, {0, 0, 1, height}, 255), fill(grey, {width - 1, 0, 1, height}, 255);
  const int side = std::min(width / 5, height / 4) / (2 * kSteps) * 2 * kSteps;
  if (side > 0) draw_fields(grey, height - height / 16 - side, side);
  draw_text(grey, text, height - height / 8 - side);
  Picture picture(width, height, 3);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c) picture.at(x, y, c) = static_cast<std::uint16_t>(257 * grey.at<std::uint8_t>(y, x));
  return picture;
}

std::vector<std::string> identification_text(const capture::Monitor& monitor, const Rig* rig) {
  const std::string refresh = monitor.refresh_hz > 0 ? fmt::format(", {:.0f} Hz", monitor.refresh_hz) : "";
  std::vector<std::string> text{monitor.name, fmt::format("{} x {}{}", monitor.width, monitor.height, refresh)};
  if (!monitor.edid.empty()) text.push_back(monitor.edid);
  for (const ProjectorSpec& p : rig != nullptr ? rig->projectors : std::vector<ProjectorSpec>())
    if (monitor.is(p.monitor)) text.push_back("projector " + p.id);
  return text;
}

Result<void> identify_monitors(const Rig* rig, double seconds, Progress& progress) {
  CS_TRY(const std::vector<capture::Monitor> monitors, capture::list_monitors());
  std::vector<std::unique_ptr<capture::Projector>> windows;
  for (const capture::Monitor& m : monitors) {
    CS_TRY(auto window, capture::open_window_projector(m.name, m.width, m.height, m.name, "countershade " + m.name));
    CS_TRY_VOID(window->show(identification_picture(m.width, m.height, identification_text(m, rig))));
    windows.push_back(std::move(window));
  }
  for (double done = 0; done < seconds; done += 0.1) {
    progress.step("identify", done, seconds);
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  progress.step("identify", seconds, seconds);
  return {};
}

}  // namespace countershade::tools
