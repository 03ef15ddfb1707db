#include "capture/device/window.h"

#define GLFW_INCLUDE_GLEXT
#include <GLFW/glfw3.h>

#include <array>
#include <cctype>
#include <cmath>
#include <utility>

#include "capture/device/display.h"
#include "capture/device/edid.h"

namespace countershade::capture {

namespace {

std::string glfw_reason() {
  const char* text = nullptr;
  glfwGetError(&text);
  return text != nullptr ? text : "no reason given";
}

// Connects to the display. Never disconnected: other windows of the process may live on.
Result<void> connect() {
  if (glfwInit() == GLFW_TRUE) return {};
  return error(ErrorCode::kDevice,
               "there is no display to show pictures on ({}): start this on the desktop of the machine, or set DISPLAY",
               glfw_reason());
}

std::string altered_colours(GLFWmonitor* monitor) {
  const GLFWgammaramp* ramp = glfwGetGammaRamp(monitor);
  glfwGetError(nullptr);  // not every window system tells
  if (ramp == nullptr) return "";
  return altered_by_table({ramp->red, ramp->size}, {ramp->green, ramp->size}, {ramp->blue, ramp->size});
}

std::string altered_scale(GLFWmonitor* monitor) {
  float x = 1, y = 1;
  glfwGetMonitorContentScale(monitor, &x, &y);
  if (std::abs(x - 1) < 0.01 && std::abs(y - 1) < 0.01) return "";
  return fmt::format("the desktop enlarges what it shows {:.2f} times: set its scaling to 100 %", x);
}

Monitor describe(GLFWmonitor* monitor) {
  const GLFWvidmode* mode = glfwGetVideoMode(monitor);
  const char* name = glfwGetMonitorName(monitor);
  const std::string colours = altered_colours(monitor), scale = altered_scale(monitor);
  return {name != nullptr ? name : "",
          mode ? mode->width : 0,
          mode ? mode->height : 0,
          mode ? static_cast<double>(mode->refreshRate) : 0.0,
          fmt::format("{}{}{}", colours, colours.empty() || scale.empty() ? "" : "; ", scale),
          name != nullptr ? name_on_output(name) : ""};
}

Result<GLFWmonitor*> find_monitor(const std::string& projector, const std::string& name, int width, int height) {
  int count = 0;
  GLFWmonitor** monitors = glfwGetMonitors(&count);
  std::string names;
  std::vector<int> fitting;
  for (int i = 0; i < count; ++i) {
    const Monitor m = describe(monitors[i]);
    names +=
        fmt::format("{}'{}' ({}x{}{}{})", i ? ", " : "", m.name, m.width, m.height, m.edid.empty() ? "" : ", ", m.edid);
    if (m.is(name)) fitting.push_back(i);
  }
  if (fitting.empty())
    return error(ErrorCode::kDevice,
                 "projector '{}': there is no monitor '{}'; there is {}: connect it, or correct `monitor` "
                 "in the rig",
                 projector, name, names.empty() ? "none" : names);
  if (fitting.size() > 1)
    return error(ErrorCode::kDevice,
                 "projector '{}': monitor '{}' fits several of {}: name it by its output in the rig", projector, name,
                 names);
  const Monitor found = describe(monitors[fitting[0]]);
  if (found.width != width || found.height != height)
    return error(
        ErrorCode::kDevice,
        "projector '{}': monitor '{}' shows {}x{} pixels, the rig says {}x{}: set the monitor's mode (xrandr) or "
        "correct the rig",
        projector, found.name, found.width, found.height, width, height);
  return monitors[fitting[0]];
}

// A function of the current context's driver; false where it has none of that name.
template <class Function>
bool fetch(Function& function, const char* name) {
  function = reinterpret_cast<Function>(glfwGetProcAddress(name));
  return function != nullptr;
}

Result<void> check_size(GLFWwindow* window, const std::string& projector, int width, int height) {
  int found_width = 0, found_height = 0;
  glfwGetFramebufferSize(window, &found_width, &found_height);
  if (found_width == width && found_height == height) return {};
  return error(
      ErrorCode::kDevice,
      "projector '{}': the window has {}x{} pixels instead of {}x{}: switch the desktop's scaling off and leave "
      "the window alone",
      projector, found_width, found_height, width, height);
}

// The few functions of OpenGL 1.1 that a picture needs, fetched from the driver.
struct OpenGl {
  decltype(&glDrawPixels) draw_pixels = nullptr;
  decltype(&glRasterPos2f) raster_position = nullptr;
  decltype(&glPixelZoom) pixel_zoom = nullptr;
  decltype(&glPixelStorei) pixel_store = nullptr;
  decltype(&glDisable) disable = nullptr;
  decltype(&glViewport) viewport = nullptr;
  decltype(&glFinish) finish = nullptr;
  decltype(&glGetError) get_error = nullptr;

  bool load() {
    return fetch(draw_pixels, "glDrawPixels") && fetch(raster_position, "glRasterPos2f") &&
           fetch(pixel_zoom, "glPixelZoom") && fetch(pixel_store, "glPixelStorei") && fetch(disable, "glDisable") &&
           fetch(viewport, "glViewport") && fetch(finish, "glFinish") && fetch(get_error, "glGetError");
  }
};

class WindowProjector final : public Projector {
 public:
  WindowProjector(std::string id, int width, int height, double refresh_hz, GLFWwindow* window)
      : id_(std::move(id)),
        width_(width),
        height_(height),
        refresh_hz_(refresh_hz),
        window_(window),
        full_screen_(glfwGetWindowMonitor(window) != nullptr) {}
  ~WindowProjector() override { glfwDestroyWindow(window_); }
  WindowProjector(const WindowProjector&) = delete;
  WindowProjector& operator=(const WindowProjector&) = delete;

  const std::string& id() const override { return id_; }
  int width() const override { return width_; }
  int height() const override { return height_; }
  double refresh_hz() const override { return refresh_hz_; }

  Result<void> prepare() {
    glfwMakeContextCurrent(window_);
    if (!gl_.load())
      return error(ErrorCode::kDevice, "projector '{}': the display's OpenGL cannot draw pictures: install its driver",
                   id_);
    glfwSwapInterval(1);
    return check_size(window_, id_, width_, height_);
  }

  Result<void> show(const Picture& picture) override {
    CS_TRY_VOID(hand_over(picture));
    return taken();
  }

  Result<void> hand_over(const Picture& picture) override {
    CS_CHECK(picture.same_size(width_, height_) && picture.channels() == 3,
             "a picture in the projector's own resolution");
    bytes_.resize(picture.data().size());
    for (std::size_t i = 0; i < bytes_.size(); ++i)
      bytes_[i] = static_cast<std::uint8_t>((picture.data()[i] + 128) / 257);
    glfwMakeContextCurrent(window_);
    glfwPollEvents();
    CS_TRY_VOID(check_there());
    CS_TRY_VOID(check_size(window_, id_, width_, height_));
    draw();
    glfwSwapBuffers(window_);
    return {};
  }

  Result<void> taken() override {
    glfwMakeContextCurrent(window_);
    gl_.finish();
    int x = 0, y = 0;
    glfwGetWindowPos(window_, &x, &y);  // an answer of the window system: it has done what was asked before
    if (const unsigned code = gl_.get_error(); code != 0)
      return error(ErrorCode::kDevice,
                   "projector '{}': OpenGL error {:#x} while showing a picture: check the display's driver", id_, code);
    glfwPollEvents();
    return {};
  }

 private:
  // A monitor that is unplugged leaves its picture in a window on another one.
  Result<void> check_there() const {
    if (full_screen_ && glfwGetWindowMonitor(window_) == nullptr)
      return error(
          ErrorCode::kDevice,
          "projector '{}': its monitor is gone: plug it in again; what is stored is kept, and the same command "
          "resumes",
          id_);
    if (glfwWindowShouldClose(window_))
      return error(
          ErrorCode::kDevice,
          "projector '{}': its window was closed: leave it alone; what is stored is kept, and the same command "
          "resumes",
          id_);
    return {};
  }
  void draw() const {
    gl_.disable(GL_DITHER);
    gl_.viewport(0, 0, width_, height_);
    gl_.pixel_store(GL_UNPACK_ALIGNMENT, 1);
    gl_.raster_position(-1, 1);  // top left
    gl_.pixel_zoom(1, -1);       // row 0 on top
    gl_.draw_pixels(width_, height_, GL_RGB, GL_UNSIGNED_BYTE, bytes_.data());
  }

  std::string id_;
  int width_, height_;
  double refresh_hz_;
  GLFWwindow* window_;
  bool full_screen_;
  OpenGl gl_;
  std::vector<std::uint8_t> bytes_;
};

// The functions that copy a texture to a window, fetched from the driver.
struct BlitGl {
  PFNGLGENFRAMEBUFFERSPROC gen_framebuffers = nullptr;
  PFNGLBINDFRAMEBUFFERPROC bind_framebuffer = nullptr;
  PFNGLFRAMEBUFFERTEXTURE2DPROC framebuffer_texture = nullptr;
  PFNGLCHECKFRAMEBUFFERSTATUSPROC check_status = nullptr;
  PFNGLBLITFRAMEBUFFERPROC blit = nullptr;
  PFNGLFENCESYNCPROC fence = nullptr;
  PFNGLWAITSYNCPROC wait = nullptr;
  PFNGLDELETESYNCPROC delete_sync = nullptr;
  decltype(&glFlush) flush = nullptr;
  decltype(&glDisable) disable = nullptr;
  decltype(&glGetError) get_error = nullptr;

  bool load() {
    return fetch(gen_framebuffers, "glGenFramebuffers") && fetch(bind_framebuffer, "glBindFramebuffer") &&
           fetch(framebuffer_texture, "glFramebufferTexture2D") && fetch(check_status, "glCheckFramebufferStatus") &&
           fetch(blit, "glBlitFramebuffer") && fetch(fence, "glFenceSync") && fetch(wait, "glWaitSync") &&
           fetch(delete_sync, "glDeleteSync") && fetch(flush, "glFlush") && fetch(disable, "glDisable") &&
           fetch(get_error, "glGetError");
  }
};

class GlfwTextureDisplay final : public TextureDisplay {
 public:
  ~GlfwTextureDisplay() override {
    for (auto it = windows_.rbegin(); it != windows_.rend(); ++it) glfwDestroyWindow(it->handle);
  }

  Result<void> add(const DisplayWindow& spec, int& right) {
    GLFWmonitor* place = nullptr;
    if (!spec.monitor.empty()) {
      CS_TRY(place, find_monitor(spec.projector, spec.monitor, spec.width, spec.height));
    }
    glfwDefaultWindowHints();
    glfwWindowHint(GLFW_RESIZABLE, GLFW_FALSE);
    glfwWindowHint(GLFW_AUTO_ICONIFY, GLFW_FALSE);
    glfwWindowHint(GLFW_REFRESH_RATE, GLFW_DONT_CARE);
    glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 4);
    glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
    glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
    GLFWwindow* shared = windows_.empty() ? nullptr : windows_[0].handle;
    GLFWwindow* handle =
        glfwCreateWindow(spec.width, spec.height, ("countershade " + spec.projector).c_str(), place, shared);
    if (handle == nullptr)
      return error(ErrorCode::kDevice,
                   "projector '{}': no window with OpenGL 4.3 could be opened ({}): check the display's driver",
                   spec.projector, glfw_reason());
    windows_.push_back({spec, handle, 0});
    if (place == nullptr) glfwSetWindowPos(handle, right, 0), right += spec.width;
    if (place != nullptr) glfwSetInputMode(handle, GLFW_CURSOR, GLFW_CURSOR_HIDDEN);
    glfwSetWindowUserPointer(handle, this);
    glfwSetCharCallback(handle, [](GLFWwindow* window, unsigned code) {
      if (code < 128) static_cast<GlfwTextureDisplay*>(glfwGetWindowUserPointer(window))->type(static_cast<char>(code));
    });
    glfwSetKeyCallback(handle, [](GLFWwindow* window, int key, int, int action, int) {
      if (key == GLFW_KEY_ESCAPE && action == GLFW_PRESS)
        static_cast<GlfwTextureDisplay*>(glfwGetWindowUserPointer(window))->type('q');
    });
    glfwMakeContextCurrent(handle);
    if (!gl_.load())
      return error(ErrorCode::kDevice, "projector '{}': the display's OpenGL cannot copy textures: install its driver",
                   spec.projector);
    glfwSwapInterval(windows_.size() == 1 ? 1 : 0);  // one wait for all windows
    gl_.gen_framebuffers(1, &windows_.back().framebuffer);
    return {};
  }

  Result<void> present(std::span<const unsigned> textures) override {
    CS_CHECK(textures.size() == windows_.size(), "one texture per window");
    const GLsync drawn = gl_.fence(GL_SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl_.flush();
    for (std::size_t q = windows_.size(); q-- > 0;) {  // the first one last: it waits, and stays current
      glfwMakeContextCurrent(windows_[q].handle);
      gl_.wait(drawn, 0, GL_TIMEOUT_IGNORED);
      CS_TRY_VOID(copy(windows_[q], textures[q]));
      glfwSwapBuffers(windows_[q].handle);
    }
    gl_.delete_sync(drawn);
    glfwPollEvents();
    return {};
  }

  std::string typed() override {
    glfwPollEvents();
    for (const Window& w : windows_)
      if (glfwWindowShouldClose(w.handle)) typed_ += 'q';
    return std::exchange(typed_, "");
  }

  void use_first() { glfwMakeContextCurrent(windows_[0].handle); }

 private:
  struct Window {
    DisplayWindow spec;
    GLFWwindow* handle;
    unsigned framebuffer;
  };

  void type(char c) { typed_ += static_cast<char>(std::tolower(static_cast<unsigned char>(c))); }

  Result<void> copy(const Window& window, unsigned texture) const {
    const int width = window.spec.width, height = window.spec.height;
    CS_TRY_VOID(check_size(window.handle, window.spec.projector, width, height));
    gl_.disable(GL_DITHER);
    gl_.bind_framebuffer(GL_READ_FRAMEBUFFER, window.framebuffer);
    gl_.framebuffer_texture(GL_READ_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, texture, 0);
    const unsigned status = gl_.check_status(GL_READ_FRAMEBUFFER);
    gl_.bind_framebuffer(GL_DRAW_FRAMEBUFFER, 0);
    gl_.blit(0, 0, width, height, 0, height, width, 0, GL_COLOR_BUFFER_BIT, GL_NEAREST);  // row 0 to the top
    const unsigned code = gl_.get_error();
    if (status == GL_FRAMEBUFFER_COMPLETE && code == 0) return {};
    return error(ErrorCode::kDevice,
                 "projector '{}': OpenGL error {:#x}, framebuffer {:#x} while showing: check the display's driver",
                 window.spec.projector, code, status);
  }

  std::vector<Window> windows_;
  BlitGl gl_;
  std::string typed_;
};

}  // namespace

std::string altered_by_table(std::span<const unsigned short> red, std::span<const unsigned short> green,
                             std::span<const unsigned short> blue) {
  const std::size_t size = std::min({red.size(), green.size(), blue.size()});
  if (size < 2) return "";
  const auto share = [&](std::size_t i) { return static_cast<double>(i) / static_cast<double>(size - 1); };
  double worst = 0, lit = 0;
  for (std::size_t i = 0; i < size; ++i)
    for (const unsigned short value : {red[i], green[i], blue[i]}) {
      worst = std::max(worst, std::abs(value / 65535.0 - share(i)));
      lit += value;
    }
  if (worst < 0.02 || lit == 0) return "";
  const auto percent = [&](std::size_t i) {
    return fmt::format("{:.0f}, {:.0f}, {:.0f}", red[i] / 655.35, green[i] / 655.35, blue[i] / 655.35);
  };
  return fmt::format(
      "the desktop changes its colours (white leaves as {} %, half as {} %): switch night light, colour profile and "
      "brightness of the desktop off (xrandr --gamma 1:1:1 --brightness 1)",
      percent(size - 1), percent((size - 1) / 2));
}

Result<std::vector<Monitor>> list_monitors() {
  CS_TRY_VOID(connect());
  int count = 0;
  GLFWmonitor** monitors = glfwGetMonitors(&count);
  std::vector<Monitor> found;
  for (int i = 0; i < count; ++i) found.push_back(describe(monitors[i]));
  return found;
}

Result<std::unique_ptr<Projector>> open_window_projector(const std::string& id, int width, int height,
                                                         const std::string& monitor, const std::string& title,
                                                         int left) {
  CS_TRY_VOID(connect());
  GLFWmonitor* place = nullptr;
  if (!monitor.empty()) {
    CS_TRY(place, find_monitor(id, monitor, width, height));
  }
  glfwDefaultWindowHints();
  glfwWindowHint(GLFW_RESIZABLE, GLFW_FALSE);
  glfwWindowHint(GLFW_AUTO_ICONIFY, GLFW_FALSE);  // a projector stays when another window gets the focus
  glfwWindowHint(GLFW_REFRESH_RATE, GLFW_DONT_CARE);
  GLFWwindow* window = glfwCreateWindow(width, height, title.c_str(), place, nullptr);
  if (window == nullptr)
    return error(ErrorCode::kDevice,
                 "projector '{}': no window with OpenGL could be opened ({}): check the display's driver", id,
                 glfw_reason());
  GLFWmonitor* shown_on = place != nullptr ? place : glfwGetPrimaryMonitor();
  const double refresh_hz = shown_on != nullptr ? describe(shown_on).refresh_hz : 0;
  auto projector = std::make_unique<WindowProjector>(id, width, height, refresh_hz, window);
  if (place == nullptr) glfwSetWindowPos(window, left, 0);
  if (place != nullptr) glfwSetInputMode(window, GLFW_CURSOR, GLFW_CURSOR_HIDDEN);
  CS_TRY_VOID(projector->prepare());
  return std::unique_ptr<Projector>(std::move(projector));
}

Result<std::unique_ptr<TextureDisplay>> TextureDisplay::open(const std::vector<DisplayWindow>& windows) {
  CS_CHECK(!windows.empty(), "at least one window");
  CS_TRY_VOID(connect());
  auto display = std::make_unique<GlfwTextureDisplay>();
  int right = 0;
  for (const DisplayWindow& window : windows) CS_TRY_VOID(display->add(window, right));
  display->use_first();
  return std::unique_ptr<TextureDisplay>(std::move(display));
}

}  // namespace countershade::capture
