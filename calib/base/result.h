// Result<T>: a value, or the reason why the world did not give one. Spelled like std::expected (C++23).
#pragma once

#include <fmt/format.h>

#include <string>
#include <utility>
#include <variant>

#include "calib/base/check.h"

namespace countershade {

// One code per remedy, not per cause.
enum class ErrorCode {
  kBadValue,     // the operator wrote something wrong: correct the named value
  kBadFile,      // a file is missing, truncated or not what it should be: replace or restore it
  kIo,           // reading or writing failed: disk, permissions
  kExists,       // the output is already there: choose another name or remove it
  kDevice,       // a camera, display or GL context failed: look at the device
  kRefused,      // the data cannot answer the question: take better or other photos, or state a prior
  kUnsupported,  // this version cannot do it
};

// `message` names the thing, its value, the bound and what to do next; one sentence or more, no trailing newline.
struct Error {
  ErrorCode code;
  std::string message;
};

template <class... Args>
Error error(ErrorCode code, fmt::format_string<Args...> format, Args&&... args) {
  return Error{code, fmt::format(format, std::forward<Args>(args)...)};
}

template <class T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::in_place_index<0>, std::move(value)) {}      // NOLINT: implicit as in std::expected
  Result(Error error) : state_(std::in_place_index<1>, std::move(error)) {}  // NOLINT
  bool has_value() const { return state_.index() == 0; }
  explicit operator bool() const { return has_value(); }
  T& value() & {
    CS_CHECK(has_value(), error().message);
    return std::get<0>(state_);
  }
  const T& value() const& {
    CS_CHECK(has_value(), error().message);
    return std::get<0>(state_);
  }
  T&& value() && {
    CS_CHECK(has_value(), error().message);
    return std::get<0>(std::move(state_));
  }
  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T&& operator*() && { return std::move(*this).value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }
  const Error& error() const { return std::get<1>(state_); }

 private:
  std::variant<T, Error> state_;
};

template <>
class [[nodiscard]] Result<void> {
 public:
  Result() = default;
  Result(Error error) : error_(std::move(error)), failed_(true) {}  // NOLINT: implicit as in std::expected
  bool has_value() const { return !failed_; }
  explicit operator bool() const { return !failed_; }
  void value() const { CS_CHECK(!failed_, error_.message); }
  const Error& error() const { return error_; }

 private:
  Error error_{ErrorCode::kBadValue, ""};
  bool failed_ = false;
};

}  // namespace countershade

#define CS_CONCAT_INNER(a, b) a##b
#define CS_CONCAT(a, b) CS_CONCAT_INNER(a, b)
// CS_TRY(auto x, f()): x = the value of f(), or return its error from this function.
#define CS_TRY(declaration, expression)                                                 \
  auto CS_CONCAT(cs_result_, __LINE__) = (expression);                                  \
  if (!CS_CONCAT(cs_result_, __LINE__)) return CS_CONCAT(cs_result_, __LINE__).error(); \
  declaration = *std::move(CS_CONCAT(cs_result_, __LINE__))
// CS_TRY_VOID(f()): return the error of f() from this function, if it has one.
#define CS_TRY_VOID(expression) \
  if (auto cs_result = (expression); !cs_result) return cs_result.error()
