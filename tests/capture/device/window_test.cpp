#include "capture/device/window.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>

#include "tests/capture/fake_room.h"
#include "tests/support/xvfb.h"

namespace countershade::capture {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

constexpr int kWidth = 322, kHeight = 201;  // odd, so that no row is a multiple of anything

std::string read_line(int file) {
  std::string line;
  for (char c = 0; ::read(file, &c, 1) == 1 && c != '\n';) line += c;
  return line;
}

// Runs `work` in a process of its own that is connected to the display; it says lines, and waits for a go after each.
class Client {
 public:
  using Say = std::function<void(const std::string&)>;
  Client(const std::string& display, const std::function<void(const Say&)>& work) {
    int ends[2];
    if (socketpair(AF_UNIX, SOCK_STREAM, 0, ends) != 0) return;
    process_ = fork();
    if (process_ == 0) {
      close(ends[0]);
      setenv("DISPLAY", display.c_str(), 1);
      unsetenv("WAYLAND_DISPLAY");
      work([&](const std::string& text) {
        const std::string line = text + "\n";
        if (write(ends[1], line.data(), line.size()) < 0) _exit(1);
        read_line(ends[1]);
      });
      _exit(0);
    }
    close(ends[1]);
    line_ = ends[0];
  }
  ~Client() {
    close(line_);
    kill(process_, SIGKILL);
    waitpid(process_, nullptr, 0);
  }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;
  std::string hear() { return read_line(line_); }
  void go() { EXPECT_EQ(write(line_, "\n", 1), 1); }

 private:
  pid_t process_ = -1;
  int line_ = -1;
};

Picture random_picture(const std::string& name, int width, int height) {
  Random random(hash_name(name));
  Picture picture(width, height, 3);
  for (std::uint16_t& v : picture.data()) v = static_cast<std::uint16_t>(random.bits());
  return picture;
}

std::vector<std::uint8_t> eight_bits(const Picture& picture) {
  std::vector<std::uint8_t> bytes;
  for (std::uint16_t v : picture.data()) bytes.push_back(static_cast<std::uint8_t>(std::lround(v / 257.0)));
  return bytes;
}

std::string show(const Result<std::unique_ptr<Projector>>& projector, const Picture& picture) {
  if (!projector) return projector.error().message;
  const auto shown = (*projector)->show(picture);
  return shown ? "shown" : shown.error().message;
}

#define START_DISPLAY(scratch)                                         \
  const testing::XvfbDisplay display(scratch / "fb", kWidth, kHeight); \
  if (!display.running()) GTEST_SKIP() << "Xvfb is not installed here"

TEST(WindowProjector, FullScreenShowsEveryBitOnTheNamedMonitor) {
  fake::Scratch scratch("window");
  START_DISPLAY(scratch);
  const Picture first = random_picture("first", kWidth, kHeight), second = random_picture("second", kWidth, kHeight);
  Client client(display.name(), [&](const Client::Say& say) {
    const auto monitors = list_monitors();
    if (!monitors || monitors->empty()) return say("no monitor");
    const auto projector = open_window_projector("left", kWidth, kHeight, monitors->front().name, "pictures");
    say(show(projector, first));
    say(show(projector, second));
  });
  for (const Picture* picture : {&first, &second}) {
    ASSERT_EQ(client.hear(), "shown");
    EXPECT_TRUE(display.pixels(kWidth, kHeight) == eight_bits(*picture));
    client.go();
  }
}

TEST(WindowProjector, WindowShowsEveryBitToo) {
  fake::Scratch scratch("windowed");
  START_DISPLAY(scratch);
  const Picture picture = random_picture("windowed", 123, 71);
  Client client(display.name(), [&](const Client::Say& say) {
    say(show(open_window_projector("left", 123, 71, "", "pictures"), picture));
  });
  ASSERT_EQ(client.hear(), "shown");
  EXPECT_TRUE(display.pixels(123, 71) == eight_bits(picture));
}

TEST(WindowProjector, MonitorThatIsNotThereOrHasAnotherModeIsNamed) {
  fake::Scratch scratch("monitors");
  START_DISPLAY(scratch);
  Client client(display.name(), [&](const Client::Say& say) {
    const std::string name = list_monitors()->front().name;
    say(name);
    say(open_window_projector("left", kWidth, kHeight, "HDMI-7", "").error().message);
    say(open_window_projector("left", 1280, 800, name, "").error().message);
  });
  const std::string name = client.hear();
  client.go();
  EXPECT_THAT(client.hear(), AllOf(HasSubstr("no monitor 'HDMI-7'"), HasSubstr("'" + name + "' (322x201)")));
  client.go();
  EXPECT_THAT(client.hear(), AllOf(HasSubstr(name), HasSubstr("322x201"), HasSubstr("1280x800"), HasSubstr("left")));
}

TEST(WindowProjector, AWindowThatWasClosedIsNamedAndShowsNothingMore) {
  fake::Scratch scratch("closed");
  START_DISPLAY(scratch);
  const Picture first = random_picture("before", 123, 71), second = random_picture("after", 123, 71);
  Client client(display.name(), [&](const Client::Say& say) {
    const auto projector = open_window_projector("left", 123, 71, "", "pictures");
    say(show(projector, first));
    say(show(projector, second));
  });
  ASSERT_EQ(client.hear(), "shown");
  ASSERT_TRUE(display.close_window("pictures"));
  client.go();
  EXPECT_THAT(client.hear(), AllOf(HasSubstr("projector 'left'"), HasSubstr("closed"), HasSubstr("resumes")));
  EXPECT_TRUE(display.pixels(123, 71) == eight_bits(first));
}

TEST(WindowProjector, WithoutADisplayTheRemedyIsNamed) {
  Client client(":987654", [&](const Client::Say& say) { say(list_monitors().error().message); });
  EXPECT_THAT(client.hear(), AllOf(HasSubstr("no display"), HasSubstr("DISPLAY")));
}

}  // namespace
}  // namespace countershade::capture
