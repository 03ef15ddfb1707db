// Which packets of a GigE Vision camera's stream reach the program (GVSP; GigE Vision 2.0, part 4).
#pragma once

#include <cstdint>

#include "calib/base/result.h"

namespace countershade::capture {

// What a whole photo is made of.
struct StreamShape {
  int port = 0;                     // UDP, on which the stream arrives
  std::uint32_t packet_size = 0;    // bytes, with the headers of IP and UDP
  std::uint32_t image_bytes = 0;    // that a photo has at least
  std::uint32_t payload_bytes = 0;  // that it has at most
};

// Makes the kernel drop whatever cannot belong to such a photo before it is received: headers cut short, packets beyond
// the photo, data packets that are not full though others follow (they would leave a hole that no flag tells of),
// leaders of anything but a picture, kinds of packets that were not asked for. What is dropped is lost, and is asked
// for again like everything that is lost. Aravis (0.8.26) trusts such packets, and a short one is the end of the
// process. Makes the receive buffer large, too, where this process may. Error: kDevice when the kernel takes no filter.
Result<void> filter_stream(const StreamShape& shape);

}  // namespace countershade::capture
