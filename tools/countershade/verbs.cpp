#include "tools/countershade/verbs.h"

namespace countershade::tools {

double Context::seconds() const {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
}

Result<void> Context::record(const std::filesystem::path& folder,
                             const std::vector<std::filesystem::path>& inputs) const {
  Provenance provenance;
  provenance.version = version;
  provenance.command_line = command_line;
  provenance.options = options;
  provenance.seconds = seconds();
  for (const auto& path : inputs) {
    CS_TRY(const std::string hash, hash_file(path));
    provenance.input_hashes.emplace_back(std::filesystem::absolute(path).lexically_normal().string(), hash);
  }
  return write_provenance(folder, provenance);
}

FillFolder Context::recorder(std::vector<std::filesystem::path> inputs) const {
  return [this, inputs = std::move(inputs)](const std::filesystem::path& hidden) { return record(hidden, inputs); };
}

}  // namespace countershade::tools
