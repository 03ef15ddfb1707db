#include "calib/base/parallel.h"

#include <tbb/parallel_for.h>

namespace countershade {

void parallel_for(int count, const std::function<void(int)>& body) {
  if (count > 0) tbb::parallel_for(0, count, body);
}

}  // namespace countershade
