// Loops over independent rows on all cores; results do not depend on the number of threads.
#pragma once

#include <functional>

namespace countershade {

// Calls body(i) once for each i in [0, count), from several threads.
void parallel_for(int count, const std::function<void(int)>& body);

}  // namespace countershade
