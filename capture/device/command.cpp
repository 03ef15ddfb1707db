#include "capture/device/command.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <optional>

#include "calib/image/image_file.h"
#include "capture/device/pixel_format.h"

namespace countershade::capture {

namespace fs = std::filesystem;

namespace {

double now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// What a command said and how it ended.
struct Ended {
  int exit_code = -1;  // -1: it was killed since it took too long
  std::string said;
};

// /bin/sh in a process group of its own, whose output arrives at `out`.
pid_t start(const std::string& line, int out) {
  const pid_t process = fork();
  if (process != 0) return process;
  setpgid(0, 0);
  const int none = open("/dev/null", O_RDONLY);
  dup2(none, 0), dup2(out, 1), dup2(out, 2);
  execl("/bin/sh", "sh", "-c", line.c_str(), static_cast<char*>(nullptr));
  _exit(127);
}

// What waits at a pipe.
std::string waiting_at(int pipe) {
  std::string text;
  char part[4096];
  for (ssize_t length = 0; (length = read(pipe, part, sizeof part)) > 0;)
    text.append(part, static_cast<std::size_t>(length));
  return text;
}

// Runs a line until it ends, not until those end that it left in the background.
Result<Ended> run(const std::string& line, double timeout_s) {
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) return error(ErrorCode::kDevice, "no process can be started; close other programs");
  fcntl(ends[0], F_SETFL, O_NONBLOCK);
  const double begun = now_s();
  const pid_t process = start(line, ends[1]);
  close(ends[1]);
  Ended ended;
  int status = 0;
  bool over = process < 0, killed = false;
  while (!over) {
    ended.said += waiting_at(ends[0]);
    over = waitpid(process, &status, WNOHANG) == process;
    if (!over && !killed && now_s() - begun > timeout_s) kill(-process, SIGKILL), killed = true;
    if (!over) usleep(5000);
  }
  ended.said += waiting_at(ends[0]);
  close(ends[0]);
  if (process < 0) return error(ErrorCode::kDevice, "no process can be started; close other programs");
  if (!killed) ended.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return ended;
}

std::string last_line(std::string text) {
  while (!text.empty() && (text.back() == '\n' || text.back() == '\r')) text.pop_back();
  const std::size_t at = text.find_last_of('\n');
  return text.empty() ? "nothing" : at == std::string::npos ? text : text.substr(at + 1);
}

std::string replaced(std::string text, const std::string& what, const std::string& by) {
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += by.size())
    text.replace(at, what.size(), by);
  return text;
}

// As one word of the shell.
std::string quoted(const std::string& text) {
  return "'" + replaced(text, "'", "'\\''") + "'";
}

class CommandCamera final : public Camera {
 public:
  CommandCamera(std::string id, std::string command, const CommandCameraOptions& options, fs::path folder)
      : id_(std::move(id)), command_(std::move(command)), options_(options), folder_(std::move(folder)) {}
  ~CommandCamera() override {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  CommandCamera(const CommandCamera&) = delete;
  CommandCamera& operator=(const CommandCamera&) = delete;

  const std::string& id() const override { return id_; }

  Result<void> arm(double exposure_ms) override {
    if (!(exposure_ms >= 0))
      return error(ErrorCode::kBadValue, "camera '{}': exposure of {} ms; it must be positive, or 0 for its own", id_,
                   exposure_ms);
    const bool hears =
        command_.find("{exposure_ms}") != std::string::npos || command_.find("{exposure_s}") != std::string::npos;
    if (!hears && exposure_ms_ && *exposure_ms_ != exposure_ms)
      return error(ErrorCode::kBadValue,
                   "camera '{}': exposures of {} and {} ms, but its command says neither {{exposure_s}} nor "
                   "{{exposure_ms}}: put one into the command, or state one exposure",
                   id_, *exposure_ms_, exposure_ms);
    exposure_ms_ = exposure_ms;
    return {};
  }

  Result<Exposure> trigger() override {
    CS_CHECK(exposure_ms_, "trigger() before arm()");
    const std::string name = fmt::format("{:06}", count_);
    std::string line = replaced(command_, "{file}", quoted((folder_ / name).string()));
    line = replaced(line, "{exposure_ms}", fmt::format("{:g}", *exposure_ms_));
    line = replaced(line, "{exposure_s}", fmt::format("{:g}", *exposure_ms_ / 1e3));
    const double begun = now_s();
    CS_TRY(const Ended ended, run(line, options_.timeout_s));
    if (ended.exit_code < 0)
      return error(ErrorCode::kDevice,
                   "camera '{}': `{}` did not end within {} s and was stopped (it said: {}): try it in a terminal", id_,
                   line, options_.timeout_s, last_line(ended.said));
    if (ended.exit_code != 0)
      return error(ErrorCode::kDevice, "camera '{}': `{}` ended with exit code {} (it said: {}): try it in a terminal",
                   id_, line, ended.exit_code, last_line(ended.said));
    CS_TRY(StoredImage image, taken(name, line));
    Exposure e;
    e.full_scale = image.full_scale;
    e.exposure_ms = *exposure_ms_;
    e.timestamp_s = begun;
    e.counter = count_++;
    e.saturated = saturated_share(image.values, image.full_scale);
    e.values = std::move(image.values);
    return e;
  }

 private:
  // The photo that the command has left, which is removed.
  Result<StoredImage> taken(const std::string& name, const std::string& line) {
    std::string found;
    for (const char* ending : {".tif", ".tiff", ".png", ".exr", ".jpg", ".jpeg", ".JPG", ".TIF"}) {
      const fs::path file = folder_ / (name + ending);
      if (!fs::exists(file)) continue;
      auto image = read_image(file);
      if (!image) return error(ErrorCode::kDevice, "camera '{}': {}", id_, image.error().message);
      clear();
      return image;
    }
    for (const auto& entry : fs::directory_iterator(folder_)) found += " " + entry.path().filename().string();
    clear();
    return error(ErrorCode::kDevice,
                 "camera '{}': `{}` left no photo {}.tif, .tiff, .png, .exr or .jpg (but{}): it must add an ending to "
                 "{{file}}, and turn raw files into TIFF",
                 id_, line, name, found.empty() ? " nothing" : found);
  }
  void clear() {
    std::error_code ignored;
    for (const auto& entry : fs::directory_iterator(folder_, ignored)) fs::remove(entry.path(), ignored);
  }

  std::string id_, command_;
  CommandCameraOptions options_;
  fs::path folder_;  // its own
  std::optional<double> exposure_ms_;
  std::uint64_t count_ = 0;
};

}  // namespace

Result<std::unique_ptr<Camera>> open_command_camera(const std::string& id, const std::string& command,
                                                    const CommandCameraOptions& options) {
  if (command.find("{file}") == std::string::npos)
    return error(ErrorCode::kBadValue,
                 "camera '{}': device = \"{}\" is no command that takes a photo: {{file}} must stand in it where the "
                 "photo's name belongs, e.g. \"gphoto2 --capture-image-and-download --filename {{file}}.%C\"",
                 id, command);
  std::error_code reason;
  std::string folder = (fs::temp_directory_path(reason) / "countershade-photos-XXXXXX").string();
  if (reason || mkdtemp(folder.data()) == nullptr)
    return error(ErrorCode::kIo, "camera '{}': no folder for its photos can be made in '{}': check the disk", id,
                 folder);
  return std::unique_ptr<Camera>(std::make_unique<CommandCamera>(id, command, options, folder));
}

}  // namespace countershade::capture
