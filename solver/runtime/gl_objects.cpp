#include "solver/runtime/gl_objects.h"

#include <epoxy/gl.h>

#include <algorithm>

namespace countershade::solver {

void delete_buffer(unsigned id) {
  glDeleteBuffers(1, &id);
}
void delete_texture(unsigned id) {
  glDeleteTextures(1, &id);
}
void delete_program(unsigned id) {
  glDeleteProgram(id);
}

namespace {

// Forgets former errors of the caller's, so that the next one is ours.
void forget_errors() {
  for (int n = 0; n < 16 && glGetError() != GL_NO_ERROR; ++n) {
  }
}

}  // namespace

Result<Buffer> Buffer::make(std::string_view what, std::size_t bytes, const void* data) {
  constexpr double kMiB = 1 << 20;
  if (bytes > largest_storage_block())
    return error(
        ErrorCode::kDevice,
        "{} takes {:.0f} MiB and this GL driver allows {:.0f} MiB in one buffer: use the CPU, fewer patches or "
        "smaller pictures",
        what, static_cast<double>(bytes) / kMiB, static_cast<double>(largest_storage_block()) / kMiB);
  forget_errors();
  unsigned id = 0;
  glGenBuffers(1, &id);
  Buffer buffer(id);
  const std::size_t size = std::max<std::size_t>(16, (bytes + 15) / 16 * 16);
  glBindBuffer(GL_SHADER_STORAGE_BUFFER, id);
  glBufferData(GL_SHADER_STORAGE_BUFFER, static_cast<GLsizeiptr>(size), nullptr, GL_DYNAMIC_COPY);
  if (data != nullptr && bytes > 0) glBufferSubData(GL_SHADER_STORAGE_BUFFER, 0, static_cast<GLsizeiptr>(bytes), data);
  if (const unsigned code = glGetError(); code != GL_NO_ERROR)
    return error(ErrorCode::kDevice,
                 "GL error {:#x} while making a buffer of {:.0f} MiB for {}: free GPU memory or use the CPU", code,
                 static_cast<double>(bytes) / kMiB, what);
  return buffer;
}

void Buffer::bind_storage(unsigned binding) const {
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, binding, id());
}
void Buffer::bind_uniform(unsigned binding) const {
  glBindBufferBase(GL_UNIFORM_BUFFER, binding, id());
}

void Buffer::clear() const {
  glBindBuffer(GL_SHADER_STORAGE_BUFFER, id());
  const unsigned zero = 0;
  glClearBufferData(GL_SHADER_STORAGE_BUFFER, GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT, &zero);
}

std::vector<float> Buffer::read_floats(std::size_t count) const {
  std::vector<float> values(count);
  glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
  glBindBuffer(GL_SHADER_STORAGE_BUFFER, id());
  glGetBufferSubData(GL_SHADER_STORAGE_BUFFER, 0, static_cast<GLsizeiptr>(count * sizeof(float)), values.data());
  return values;
}

std::vector<unsigned> Buffer::read_words(std::size_t count) const {
  std::vector<unsigned> values(count);
  glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
  glBindBuffer(GL_SHADER_STORAGE_BUFFER, id());
  glGetBufferSubData(GL_SHADER_STORAGE_BUFFER, 0, static_cast<GLsizeiptr>(count * sizeof(unsigned)), values.data());
  return values;
}

Result<Texture> Texture::make(std::string_view what, int width, int height) {
  forget_errors();
  int limit = 0;
  glGetIntegerv(GL_MAX_TEXTURE_SIZE, &limit);
  if (width > limit || height > limit)
    return error(ErrorCode::kDevice, "{} is {} x {} and this GL driver's textures end at {}: use the CPU", what, width,
                 height, limit);
  unsigned id = 0;
  glGenTextures(1, &id);
  Texture texture(id);
  glBindTexture(GL_TEXTURE_2D, id);
  glTexStorage2D(GL_TEXTURE_2D, 1, GL_RGBA16, width, height);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  if (const unsigned code = glGetError(); code != GL_NO_ERROR)
    return error(ErrorCode::kDevice,
                 "GL error {:#x} while making a texture of {} x {} for {}: free GPU memory or use the CPU", code, width,
                 height, what);
  return texture;
}

void Texture::bind_image(unsigned unit) const {
  glBindImageTexture(unit, id(), 0, GL_FALSE, 0, GL_WRITE_ONLY, GL_RGBA16);
}

Result<BufferTexture> BufferTexture::make(std::string_view what, const Buffer& buffer, std::size_t texels) {
  int limit = 0;
  glGetIntegerv(GL_MAX_TEXTURE_BUFFER_SIZE, &limit);
  if (texels > static_cast<std::size_t>(limit))
    return error(ErrorCode::kDevice, "{} have {} cells and this GL driver allows {}: use the CPU or fewer patches",
                 what, texels, limit);
  unsigned id = 0;
  glGenTextures(1, &id);
  BufferTexture texture(id);
  glBindTexture(GL_TEXTURE_BUFFER, id);
  glTexBuffer(GL_TEXTURE_BUFFER, GL_RGBA32F, buffer.id());
  return texture;
}

void BufferTexture::bind_texture(unsigned unit) const {
  glActiveTexture(GL_TEXTURE0 + unit);
  glBindTexture(GL_TEXTURE_BUFFER, id());
}

namespace {

std::string log_of(const ShaderText& shader, std::string log) {
  while (!log.empty() && (log.back() == '\0' || log.back() == '\n')) log.pop_back();
  std::string names;
  for (std::size_t n = 0; n < shader.files.size(); ++n)
    names += fmt::format("{}{} = {}", n ? ", " : "", n, shader.files[n]);
  return fmt::format("shader {} was rejected by {}: {} (file numbers: {}); update the GL driver or use the CPU",
                     shader.files.empty() ? "" : shader.files[0], gl_description(), log, names);
}

}  // namespace

Result<Program> Program::make(const ShaderText& shader) {
  const unsigned compiled = glCreateShader(GL_COMPUTE_SHADER);
  const char* text = shader.text.c_str();
  glShaderSource(compiled, 1, &text, nullptr);
  glCompileShader(compiled);
  int good = 0, length = 0;
  glGetShaderiv(compiled, GL_COMPILE_STATUS, &good);
  if (!good) {
    glGetShaderiv(compiled, GL_INFO_LOG_LENGTH, &length);
    std::string log(static_cast<std::size_t>(std::max(length, 0)), '\0');
    glGetShaderInfoLog(compiled, length, nullptr, log.data());
    glDeleteShader(compiled);
    return Error{ErrorCode::kDevice, log_of(shader, log)};
  }
  Program program(glCreateProgram());
  glAttachShader(program.id(), compiled);
  glLinkProgram(program.id());
  glDeleteShader(compiled);
  glGetProgramiv(program.id(), GL_LINK_STATUS, &good);
  if (!good) {
    glGetProgramiv(program.id(), GL_INFO_LOG_LENGTH, &length);
    std::string log(static_cast<std::size_t>(std::max(length, 0)), '\0');
    glGetProgramInfoLog(program.id(), length, nullptr, log.data());
    return Error{ErrorCode::kDevice, log_of(shader, log)};
  }
  return program;
}

void Program::set(int location, int value) const {
  glProgramUniform1i(id(), location, value);
}
void Program::set(int location, float value) const {
  glProgramUniform1f(id(), location, value);
}

void Program::dispatch(int groups_x, int groups_y) const {
  if (groups_x <= 0 || groups_y <= 0) return;
  glUseProgram(id());
  glDispatchCompute(static_cast<unsigned>(groups_x), static_cast<unsigned>(groups_y), 1);
}

std::size_t largest_storage_block() {
  GLint64 bytes = 0;
  glGetInteger64v(GL_MAX_SHADER_STORAGE_BLOCK_SIZE, &bytes);
  return static_cast<std::size_t>(bytes);
}

void storage_barrier() {
  glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT | GL_TEXTURE_FETCH_BARRIER_BIT | GL_BUFFER_UPDATE_BARRIER_BIT);
}

std::string gl_description() {
  const auto text = [](GLenum name) {
    const auto* value = reinterpret_cast<const char*>(glGetString(name));
    return std::string(value ? value : "?");
  };
  return text(GL_RENDERER) + ", OpenGL " + text(GL_VERSION);
}

Result<void> check_gl_version() {
  int major = 0, minor = 0;
  glGetIntegerv(GL_MAJOR_VERSION, &major);
  glGetIntegerv(GL_MINOR_VERSION, &minor);
  if (major * 10 + minor < 43)
    return error(ErrorCode::kDevice,
                 "the GL context ({}) is version {}.{} and 4.3 is needed: update the driver or use the CPU",
                 gl_description(), major, minor);
  return {};
}

}  // namespace countershade::solver
