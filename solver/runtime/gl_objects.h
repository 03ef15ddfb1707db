// GL objects that delete themselves. A context must be current wherever they are used or destroyed.
#pragma once

#include <cstddef>
#include <string_view>
#include <vector>

#include "calib/base/result.h"
#include "solver/runtime/shader.h"

namespace countershade::solver {

// Owner of one GL name.
template <void (*Delete)(unsigned)>
class GlName {
 public:
  GlName() = default;
  explicit GlName(unsigned id) : id_(id) {}
  GlName(GlName&& other) noexcept : id_(std::exchange(other.id_, 0)) {}
  GlName& operator=(GlName&& other) noexcept {
    std::swap(id_, other.id_);
    return *this;
  }
  ~GlName() {
    if (id_ != 0) Delete(id_);
  }
  unsigned id() const { return id_; }

 private:
  unsigned id_ = 0;
};

void delete_buffer(unsigned id);
void delete_texture(unsigned id);
void delete_program(unsigned id);

class Buffer : public GlName<delete_buffer> {
 public:
  Buffer() = default;
  // A buffer of at least 16 bytes, filled from data (null = undefined). Errors: kDevice when `bytes` is beyond the
  // driver's limit for a storage block (names `what`, both sizes, the remedy) or memory is short.
  static Result<Buffer> make(std::string_view what, std::size_t bytes, const void* data);
  template <class T>
  static Result<Buffer> of(std::string_view what, const std::vector<T>& values) {
    return make(what, values.size() * sizeof(T), values.data());
  }
  void bind_storage(unsigned binding) const;
  void bind_uniform(unsigned binding) const;
  void clear() const;  // to zero
  std::vector<float> read_floats(std::size_t count) const;
  std::vector<unsigned> read_words(std::size_t count) const;

 private:
  explicit Buffer(unsigned id) : GlName(id) {}
};

// RGBA16 texture that compute shaders write.
class Texture : public GlName<delete_texture> {
 public:
  Texture() = default;
  static Result<Texture> make(std::string_view what, int width, int height);
  void bind_image(unsigned unit) const;

 private:
  explicit Texture(unsigned id) : GlName(id) {}
};

// A buffer of vec4 seen as a texture: cheaper to fetch whole cells from than a storage block.
class BufferTexture : public GlName<delete_texture> {
 public:
  BufferTexture() = default;
  // Keeps a reference to the buffer's store. Errors: kDevice beyond the driver's limit of texels.
  static Result<BufferTexture> make(std::string_view what, const Buffer& buffer, std::size_t texels);
  void bind_texture(unsigned unit) const;

 private:
  explicit BufferTexture(unsigned id) : GlName(id) {}
};

class Program : public GlName<delete_program> {
 public:
  Program() = default;
  // Errors: kDevice with the driver's messages and what their file numbers mean.
  static Result<Program> make(const ShaderText& shader);
  void set(int location, int value) const;
  void set(int location, float value) const;
  void dispatch(int groups_x, int groups_y = 1) const;

 private:
  explicit Program(unsigned id) : GlName(id) {}
};

// Largest storage block of this driver, bytes.
std::size_t largest_storage_block();
// Later shaders see what earlier ones wrote to buffers.
void storage_barrier();
// kDevice when the context is older than GL 4.3.
Result<void> check_gl_version();
std::string gl_description();

}  // namespace countershade::solver
