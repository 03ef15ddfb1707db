#include "tools/bench/kill/write_calls.h"

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <map>
#include <optional>

#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <sys/user.h>
#include <sys/wait.h>
#include <unistd.h>

namespace countershade::bench {

namespace fs = std::filesystem;

#ifndef __x86_64__

Result<Ending> run_to_disaster(const std::vector<std::string>&, const fs::path&, const Doom&) {
  return error(ErrorCode::kUnsupported, "system calls can be counted on x86-64 only");
}
bool can_trace() {
  return false;
}

#else

namespace {

// How a call names what it changes: by an open file, or by a path (relative to a folder that is open, -1 = none).
struct Call {
  long number;
  const char* name;
  int file;    // argument that is a descriptor of the file itself; -1: by path
  int path;    // argument that is the path
  int folder;  // argument that is the descriptor of the path's folder; -1: the working folder
  bool removes = false;
};

// Of two paths (rename, link) it is the second, the name that is made. open and openat are counted only where they may
// change something.
constexpr Call kCalls[] = {
    {SYS_write, "write", 0, -1, -1},
    {SYS_pwrite64, "pwrite", 0, -1, -1},
    {SYS_writev, "writev", 0, -1, -1},
    {SYS_pwritev, "pwritev", 0, -1, -1},
    {SYS_pwritev2, "pwritev2", 0, -1, -1},
    {SYS_ftruncate, "ftruncate", 0, -1, -1},
    {SYS_fallocate, "fallocate", 0, -1, -1},
    {SYS_fsync, "fsync", 0, -1, -1},
    {SYS_fdatasync, "fdatasync", 0, -1, -1},
    {SYS_sendfile, "sendfile", 0, -1, -1},
    {SYS_copy_file_range, "copy_file_range", 2, -1, -1},
    {SYS_open, "open", -1, 0, -1},
    {SYS_openat, "open", -1, 1, 0},
    {SYS_creat, "create", -1, 0, -1},
    {SYS_truncate, "truncate", -1, 0, -1},
    {SYS_rename, "rename", -1, 1, -1, true},
    {SYS_renameat, "rename", -1, 3, 2, true},
    {SYS_renameat2, "rename", -1, 3, 2, true},
    {SYS_link, "link", -1, 1, -1},
    {SYS_linkat, "link", -1, 3, 2},
    {SYS_symlink, "symlink", -1, 1, -1},
    {SYS_symlinkat, "symlink", -1, 2, 1},
    {SYS_mkdir, "mkdir", -1, 0, -1},
    {SYS_mkdirat, "mkdir", -1, 1, 0},
    {SYS_rmdir, "rmdir", -1, 0, -1, true},
    {SYS_unlink, "unlink", -1, 0, -1, true},
    {SYS_unlinkat, "unlink", -1, 1, 0, true},
};

const Call* call_of(long number) {
  for (const Call& c : kCalls)
    if (c.number == number) return &c;
  return nullptr;
}

// Stops the process at the calls of the table, and at no others.
bool install_filter() {
  std::vector<sock_filter> program = {BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr))};
  const std::size_t count = std::size(kCalls);
  for (std::size_t i = 0; i < count; ++i)
    program.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, static_cast<unsigned>(kCalls[i].number),
                               static_cast<std::uint8_t>(count - i), 0));
  program.push_back(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW));
  program.push_back(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_TRACE));
  const sock_fprog filter{static_cast<unsigned short>(program.size()), program.data()};
  return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 && prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &filter) == 0;
}

[[noreturn]] void become(const std::vector<std::string>& command, int output) {
  std::vector<char*> arguments;
  for (const std::string& a : command) arguments.push_back(const_cast<char*>(a.c_str()));
  arguments.push_back(nullptr);
  dup2(output, 1);
  dup2(output, 2);
  if (ptrace(PTRACE_TRACEME, 0, nullptr, nullptr) != 0) _exit(126);
  raise(SIGSTOP);
  if (!install_filter()) _exit(126);
  execvp(arguments[0], arguments.data());
  _exit(127);
}

std::uint64_t argument(const user_regs_struct& r, int i) {
  const unsigned long long all[] = {r.rdi, r.rsi, r.rdx, r.r10, r.r8, r.r9};
  return all[i];
}

std::string text_at(pid_t thread, std::uint64_t address) {
  std::string text;
  char part[256];
  while (text.size() < 4096) {
    // Not beyond a page: the next one may not exist.
    const std::size_t room = std::min<std::size_t>(sizeof part, 4096 - (address + text.size()) % 4096);
    iovec here{part, room}, there{reinterpret_cast<void*>(address + text.size()), room};
    const ssize_t got = process_vm_readv(thread, &here, 1, &there, 1, 0);
    if (got <= 0) return text;
    const char* end = static_cast<const char*>(std::memchr(part, 0, static_cast<std::size_t>(got)));
    text.append(part, end ? static_cast<std::size_t>(end - part) : static_cast<std::size_t>(got));
    if (end) return text;
  }
  return text;
}

fs::path link_of(pid_t thread, const std::string& what) {
  std::error_code ignored;
  return fs::read_symlink("/proc/" + std::to_string(thread) + "/" + what, ignored);
}

class Tracer {
 public:
  Tracer(const fs::path& folder, const Doom& doom) : folder_(fs::weakly_canonical(folder)), doom_(doom) {}

  Result<Ending> run(const std::vector<std::string>& command);

 private:
  Result<void> start(const std::vector<std::string>& command);
  void at_call(pid_t thread);
  std::optional<std::string> counted(pid_t thread, const Call& call, const user_regs_struct& registers) const;
  void die() { ::kill(child_, SIGKILL); }
  void resume(pid_t thread, int how, int signal = 0) {
    ptrace(static_cast<__ptrace_request>(how), thread, nullptr, signal);
  }

  const fs::path folder_;
  const Doom doom_;
  pid_t child_ = -1;
  int output_ = -1;
  pid_t torn_ = -1;  // thread whose call is waited for, to die after it
  Ending ending_;
};

Result<void> Tracer::start(const std::vector<std::string>& command) {
  output_ = static_cast<int>(syscall(SYS_memfd_create, "output", 0));
  child_ = fork();
  if (child_ == 0) become(command, output_);
  int status = 0;
  if (child_ < 0 || waitpid(child_, &status, 0) != child_ || !WIFSTOPPED(status))
    return error(ErrorCode::kUnsupported, "this machine lets no program trace its child: {}", std::strerror(errno));
  const long options = PTRACE_O_TRACESECCOMP | PTRACE_O_TRACECLONE | PTRACE_O_TRACEFORK | PTRACE_O_TRACEVFORK |
                       PTRACE_O_EXITKILL | PTRACE_O_TRACESYSGOOD;
  if (ptrace(PTRACE_SETOPTIONS, child_, nullptr, options) != 0)
    return error(ErrorCode::kUnsupported, "this machine lets no program trace its child: {}", std::strerror(errno));
  resume(child_, PTRACE_CONT);
  return {};
}

// What the call changes, relative to the folder; none where that lies elsewhere.
std::optional<std::string> Tracer::counted(pid_t thread, const Call& call, const user_regs_struct& registers) const {
  fs::path path;
  if (call.file >= 0) {
    path = link_of(thread, "fd/" + std::to_string(static_cast<int>(argument(registers, call.file))));
  } else {
    if (call.number == SYS_open || call.number == SYS_openat) {
      const std::uint64_t flags = argument(registers, call.path + 1);
      if ((flags & O_ACCMODE) == O_RDONLY && (flags & (O_CREAT | O_TRUNC)) == 0) return std::nullopt;
    }
    path = text_at(thread, argument(registers, call.path));
    if (path.is_relative()) {
      const int from = call.folder < 0 ? AT_FDCWD : static_cast<int>(argument(registers, call.folder));
      path = link_of(thread, from == AT_FDCWD ? "cwd" : "fd/" + std::to_string(from)) / path;
    }
  }
  const fs::path inside = path.lexically_normal().lexically_relative(folder_);
  if (inside.empty() || *inside.begin() == "..") return std::nullopt;
  return std::string(call.name) + " " + inside.string();
}

void Tracer::at_call(pid_t thread) {
  user_regs_struct registers{};
  if (ptrace(PTRACE_GETREGS, thread, nullptr, &registers) != 0) return;
  const Call* call = call_of(static_cast<long>(registers.orig_rax));
  const std::optional<std::string> what = call ? counted(thread, *call, registers) : std::nullopt;
  if (!what) return resume(thread, PTRACE_CONT);
  const std::uint64_t number = ending_.calls.size();
  ending_.calls.push_back(*what);
  const bool here = number == doom_.at;
  if (doom_.disaster == Disaster::kKill && here) return die();
  if (doom_.disaster == Disaster::kTear && here) {
    if (call->number == SYS_write || call->number == SYS_pwrite64) registers.rdx /= 2;
    ptrace(PTRACE_SETREGS, thread, nullptr, &registers);
    torn_ = thread;
    return resume(thread, PTRACE_SYSCALL);  // to the call's end
  }
  // A full disk still removes and renames; one that can only be read does nothing at all.
  if (doom_.disaster == Disaster::kFail && number >= doom_.at && (doom_.error != ENOSPC || !call->removes)) {
    registers.orig_rax = static_cast<unsigned long long>(-1);
    registers.rax = static_cast<unsigned long long>(-doom_.error);
    ptrace(PTRACE_SETREGS, thread, nullptr, &registers);
  }
  resume(thread, PTRACE_CONT);
}

Result<Ending> Tracer::run(const std::vector<std::string>& command) {
  CS_TRY_VOID(start(command));
  for (;;) {
    int status = 0;
    const pid_t thread = waitpid(-1, &status, __WALL);
    if (thread < 0) break;
    if (WIFEXITED(status) || WIFSIGNALED(status)) {
      if (thread != child_) continue;
      ending_.killed = WIFSIGNALED(status);
      if (!ending_.killed) ending_.exit_code = WEXITSTATUS(status);
      break;
    }
    const int signal = WSTOPSIG(status), event = status >> 16;
    if (event == PTRACE_EVENT_SECCOMP)
      at_call(thread);
    else if (signal == (SIGTRAP | 0x80) && thread == torn_)
      die();
    else if (event != 0 || signal == SIGSTOP || signal == (SIGTRAP | 0x80) || signal == SIGTRAP)
      resume(thread, PTRACE_CONT);  // a new thread, or the start of the program
    else
      resume(thread, PTRACE_CONT, signal);
  }
  char part[4096];
  lseek(output_, 0, SEEK_SET);
  for (ssize_t got; (got = read(output_, part, sizeof part)) > 0;)
    ending_.output.append(part, static_cast<std::size_t>(got));
  close(output_);
  if (ending_.exit_code == 126)
    return error(ErrorCode::kUnsupported, "this machine lets no program trace or filter its child");
  if (ending_.exit_code == 127) return error(ErrorCode::kIo, "'{}' cannot be started; was it built?", command[0]);
  return std::move(ending_);
}

}  // namespace

Result<Ending> run_to_disaster(const std::vector<std::string>& command, const fs::path& folder, const Doom& doom) {
  CS_CHECK(!command.empty(), "a command");
  return Tracer(folder, doom).run(command);
}

bool can_trace() {
  return run_to_disaster({"true"}, "/nowhere", {}).has_value();
}

#endif

}  // namespace countershade::bench
