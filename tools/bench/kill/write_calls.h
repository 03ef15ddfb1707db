// The disk fails, or the power goes, at a chosen moment of a program: its n-th system call that changes a folder.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "calib/base/result.h"

namespace countershade::bench {

enum class Disaster {
  kNone,  // calls are counted, nothing else
  kKill,  // SIGKILL before the call
  kTear,  // SIGKILL after it; of a write, half of the bytes have been written
  kFail,  // this call and all later ones fail with `error`, as on a full disk (removing and renaming still work there)
};

struct Doom {
  Disaster disaster = Disaster::kNone;
  std::uint64_t at = 0;  // number of the call, from 0
  int error = 0;         // of kFail: ENOSPC, EROFS, ...
};

struct Ending {
  bool killed = false;
  int exit_code = -1;              // where it was not killed
  std::vector<std::string> calls;  // that were counted: "rename session/photos/camera/0007.tif"
  std::string output;              // stdout and stderr
};

// Runs `command` (program and arguments; looked for as execvp does). Counted are the calls of all its threads and
// children that create, write, sync, rename, link or remove what lies below `folder`, in the order in which they are
// begun. Works by ptrace and a seccomp filter, on x86-64 Linux. Errors: kUnsupported: other processors, or a machine
// that lets nobody trace; kIo: the program cannot be started.
Result<Ending> run_to_disaster(const std::vector<std::string>& command, const std::filesystem::path& folder,
                               const Doom& doom);

// Whether this machine lets a program trace its child.
bool can_trace();

}  // namespace countershade::bench
