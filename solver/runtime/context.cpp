#include <epoxy/egl.h>

#include <cstring>

#include "solver/runtime/gl_objects.h"
#include "solver/runtime/runtime.h"

namespace countershade::solver {
namespace {

class EglContext final : public HeadlessContext {
 public:
  EglContext(EGLDisplay display, EGLContext context) : display_(display), context_(context) {}
  EglContext(const EglContext&) = delete;
  EglContext& operator=(const EglContext&) = delete;
  ~EglContext() override {
    if (eglGetCurrentContext() == context_) eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    eglDestroyContext(display_, context_);  // the display stays: EGL gives every caller the same one
  }
  std::string description() const override { return gl_description(); }

 private:
  EGLDisplay display_;
  EGLContext context_;
};

bool has(const char* extensions, const char* name) {
  return extensions != nullptr && std::strstr(extensions, name) != nullptr;
}

// A place where a context may be found, best first: graphics cards, the surfaceless platform, software devices.
struct Candidate {
  const char* name;
  EGLenum platform;
  void* native;
};

std::vector<Candidate> candidates() {
  const char* client = eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
  std::vector<Candidate> cards, others;
  if (has(client, "EGL_MESA_platform_surfaceless"))
    others.push_back({"EGL surfaceless", EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY});
  if (!has(client, "EGL_EXT_device_enumeration") && !has(client, "EGL_EXT_device_base")) return others;
  EGLDeviceEXT devices[16];
  EGLint count = 0;
  if (!eglQueryDevicesEXT(16, devices, &count)) return others;
  for (int i = 0; i < count; ++i) {
    const bool software = has(eglQueryDeviceStringEXT(devices[i], EGL_EXTENSIONS), "EGL_MESA_device_software");
    (software ? others : cards).push_back({"EGL device", EGL_PLATFORM_DEVICE_EXT, devices[i]});
  }
  cards.insert(cards.end(), others.begin(), others.end());
  return cards;
}

Result<std::unique_ptr<HeadlessContext>> open_candidate(const Candidate& candidate) {
  const auto fail = [&](const char* step) {
    return error(ErrorCode::kDevice, "{}: {} failed with EGL error {:#x}", candidate.name, step,
                 static_cast<unsigned>(eglGetError()));
  };
  EGLDisplay display = eglGetPlatformDisplayEXT(candidate.platform, candidate.native, nullptr);
  if (display == EGL_NO_DISPLAY) return fail("eglGetPlatformDisplayEXT");
  if (!eglInitialize(display, nullptr, nullptr)) return fail("eglInitialize");
  const char* extensions = eglQueryString(display, EGL_EXTENSIONS);
  if (!has(extensions, "EGL_KHR_surfaceless_context") || !has(extensions, "EGL_KHR_no_config_context"))
    return error(ErrorCode::kDevice, "{}: cannot make a context without a surface", candidate.name);
  if (!eglBindAPI(EGL_OPENGL_API)) return fail("eglBindAPI(OpenGL)");
  const EGLint attributes[] = {
      EGL_CONTEXT_MAJOR_VERSION,           4,       EGL_CONTEXT_MINOR_VERSION, 3, EGL_CONTEXT_OPENGL_PROFILE_MASK,
      EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT, EGL_NONE};
  EGLContext context = eglCreateContext(display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, attributes);
  if (context == EGL_NO_CONTEXT) return fail("eglCreateContext (OpenGL 4.3 core)");
  auto owner = std::make_unique<EglContext>(display, context);
  if (!eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context)) return fail("eglMakeCurrent");
  CS_TRY_VOID(check_gl_version());
  return std::unique_ptr<HeadlessContext>(std::move(owner));
}

}  // namespace

Result<std::unique_ptr<HeadlessContext>> HeadlessContext::make() {
  std::string reasons;
  for (const Candidate& candidate : candidates()) {
    auto context = open_candidate(candidate);
    if (context) return context;
    reasons += (reasons.empty() ? "" : "; ") + context.error().message;
  }
  if (reasons.empty()) reasons = "EGL offers neither the surfaceless nor the device platform";
  return error(ErrorCode::kDevice,
               "no GL context without a window: {}. Install a GL driver (libgl1-mesa-dri) or use the CPU", reasons);
}

}  // namespace countershade::solver
