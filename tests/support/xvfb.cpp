#include "tests/support/xvfb.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <iterator>

#include <X11/Xlib.h>  // last: its macros have short names
#include <X11/Xutil.h>

namespace countershade::testing {

XvfbDisplay::XvfbDisplay(const std::filesystem::path& folder, int width, int height) : file_(folder / "Xvfb_screen0") {
  std::filesystem::create_directories(folder);
  int ends[2];
  if (pipe(ends) != 0) return;
  const std::string screen = fmt::format("{}x{}x24", width, height), number = std::to_string(ends[1]);
  server_ = fork();
  if (server_ == 0) {
    close(ends[0]);
    const int quiet = open("/dev/null", O_RDWR);
    dup2(quiet, 1), dup2(quiet, 2);
    execlp("Xvfb", "Xvfb", "-displayfd", number.c_str(), "-screen", "0", screen.c_str(), "-fbdir", folder.c_str(),
           "-nolisten", "tcp", static_cast<char*>(nullptr));
    _exit(127);
  }
  close(ends[1]);
  for (char c = 0; ::read(ends[0], &c, 1) == 1 && c != '\n';) name_ += c;
  close(ends[0]);
}

XvfbDisplay::~XvfbDisplay() {
  if (server_ <= 0) return;
  kill(server_, SIGTERM);
  waitpid(server_, nullptr, 0);
}

std::vector<std::uint8_t> XvfbDisplay::pixels(int width, int height, int left) const {
  std::ifstream stream(file_, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(stream), {}};
  const auto field = [&](int i) {  // the header is 32-bit numbers, most significant byte first
    std::uint32_t v = 0;
    for (int k = 0; k < 4; ++k) v = v << 8 | static_cast<std::uint8_t>(bytes[4 * i + k]);
    return v;
  };
  EXPECT_EQ(field(11), 32u);  // bits per pixel
  const std::size_t start = field(0) + 12 * field(19), stride = field(12);
  std::vector<std::uint8_t> rgb;
  for (int y = 0; y < height; ++y)
    for (int x = left; x < left + width; ++x)
      for (int c : {2, 1, 0}) rgb.push_back(static_cast<std::uint8_t>(bytes[start + y * stride + 4 * x + c]));
  return rgb;
}

bool XvfbDisplay::close_window(const std::string& title) const {
  Display* display = XOpenDisplay(name().c_str());
  if (display == nullptr) return false;
  Window root = DefaultRootWindow(display), parent = 0, *children = nullptr;
  unsigned count = 0;
  bool found = false;
  XQueryTree(display, root, &root, &parent, &children, &count);
  for (unsigned i = 0; i < count; ++i) {
    char* text = nullptr;
    if (XFetchName(display, children[i], &text) == 0 || text == nullptr) continue;
    if (title == text) {
      XEvent event{};
      event.xclient.type = ClientMessage, event.xclient.window = children[i], event.xclient.format = 32;
      event.xclient.message_type = XInternAtom(display, "WM_PROTOCOLS", False);
      event.xclient.data.l[0] = static_cast<long>(XInternAtom(display, "WM_DELETE_WINDOW", False));
      found = XSendEvent(display, children[i], False, NoEventMask, &event) != 0;
    }
    XFree(text);
  }
  if (children != nullptr) XFree(children);
  XCloseDisplay(display);  // what was sent has arrived then
  return found;
}

}  // namespace countershade::testing
