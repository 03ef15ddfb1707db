// The shaders, which are files of solver/runtime/shaders embedded at build.
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "calib/base/result.h"

namespace countershade::solver {

// File name and text of every shader; written by cmake/embed_shaders.cmake.
const std::vector<std::pair<std::string_view, std::string_view>>& embedded_shaders();

// A shader ready for the driver: #version, defines, and `#include "name.glsl"` lines expanded. The driver's messages
// give the number of a file and a line in it; files[number] is its name.
struct ShaderText {
  std::string text;
  std::vector<std::string> files;
};

// defines: "NAME" or "NAME value". Errors: kBadFile for a shader that is not embedded, or includes one that is not.
Result<ShaderText> shader_text(std::string_view name, const std::vector<std::string>& defines = {});

// The same for text that is at hand.
Result<ShaderText> expand_shader(std::string_view name, std::string_view body, const std::vector<std::string>& defines);

}  // namespace countershade::solver
