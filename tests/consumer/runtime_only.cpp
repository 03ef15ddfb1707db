// Says whether a GL context can be made.
#include <cstdio>

#include "solver/runtime/runtime.h"

int main() {
  const auto context = countershade::solver::HeadlessContext::make();
  std::puts(context ? (*context)->description().c_str() : context.error().message.c_str());
}
