// Whether a camera's description of itself (GenICam) can be evaluated: Aravis follows it wherever it leads.
#pragma once

#include <string>

#include "calib/base/result.h"

typedef struct _ArvDevice ArvDevice;

namespace countershade::capture {

// Of a GigE camera, before Aravis loads its description. kDevice where it says that this is longer than any camera's is
// (8 MB), and of a zipped one where it cannot be read, unpacked it would be longer than 32 MB, or an offset or length
// in the archive leads out of it, all of which Aravis (0.8.26) believes. A camera that does not answer is Aravis' to
// complain of. Takes a second and a half at most where none answers, and else as long as reading a zipped one.
Result<void> check_description_file(const std::string& address);
// Of a camera that Aravis has opened, before any feature is asked for. kDevice where a node refers to itself, by way of
// others or at once, refers to others in a chain of more than 200, or has so many ways through the nodes it refers to
// (a million) that to ask for it would take minutes, and where something that is asked for here has its value in a node
// that is not there; names the node. The first two are endless recursion in Aravis (0.8.26), and the end of the
// process; of the last it reads back what was written, and nothing reaches the camera.
Result<void> check_description(ArvDevice* device);

}  // namespace countershade::capture
