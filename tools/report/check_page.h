// What can be known before a capture, as one self-contained page: traffic lights, what to do next, pictures.
#pragma once

#include <string>
#include <vector>

#include "calib/base/result.h"
#include "calib/image/image.h"

namespace countershade::tools {

struct Finding {
  std::string what, measured, remedy;
  bool ok = true;
  bool caution = false;  // it is all right, and could be better: `remedy` says how
};

struct CheckPicture {
  std::string title, caption;
  Image values;  // (height, width, 3), 0..255
};

// "ok", "LOOK" or "WRONG".
std::string light_of(const Finding& finding);

// Errors: kIo when a picture cannot be encoded.
Result<std::string> check_html(const std::string& rig, const std::vector<Finding>& findings,
                               const std::vector<CheckPicture>& pictures);

}  // namespace countershade::tools
