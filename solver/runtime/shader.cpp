#include "solver/runtime/shader.h"

#include <algorithm>
#include <optional>

namespace countershade::solver {
namespace {

std::optional<std::string_view> embedded(std::string_view name) {
  for (const auto& [file, text] : embedded_shaders())
    if (file == name) return text;
  return std::nullopt;
}

// Appends a file with its includes; every file once.
Result<void> append(std::string_view name, std::string_view body, ShaderText& out) {
  const std::size_t number = out.files.size();
  out.files.emplace_back(name);
  out.text += fmt::format("#line 1 {}\n", number);
  int line = 0;
  while (!body.empty()) {
    const std::size_t end = std::min(body.find('\n'), body.size());
    const std::string_view text = body.substr(0, end);
    body.remove_prefix(std::min(end + 1, body.size()));
    ++line;
    constexpr std::string_view kInclude = "#include \"";
    if (text.substr(0, kInclude.size()) != kInclude) {
      out.text += fmt::format("{}\n", text);
      continue;
    }
    const std::string_view rest = text.substr(kInclude.size());
    const std::string_view file = rest.substr(0, rest.find('"'));
    if (std::find(out.files.begin(), out.files.end(), file) == out.files.end()) {
      const auto included = embedded(file);
      if (!included)
        return error(ErrorCode::kBadFile, "{}:{}: includes {}, which is no shader of this program: correct the name",
                     name, line, file);
      CS_TRY_VOID(append(file, *included, out));
    }
    out.text += fmt::format("#line {} {}\n", line + 1, number);
  }
  return {};
}

}  // namespace

Result<ShaderText> expand_shader(std::string_view name, std::string_view body,
                                 const std::vector<std::string>& defines) {
  ShaderText out;
  out.text = "#version 430 core\n";
  for (const std::string& define : defines) out.text += "#define " + define + "\n";
  CS_TRY_VOID(append(name, body, out));
  return out;
}

Result<ShaderText> shader_text(std::string_view name, const std::vector<std::string>& defines) {
  const auto body = embedded(name);
  if (!body)
    return error(ErrorCode::kBadFile, "shader {} is not part of this program: rebuild it with solver/runtime/shaders",
                 name);
  return expand_shader(name, *body, defines);
}

}  // namespace countershade::solver
