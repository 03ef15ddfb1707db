#include "capture/board/tags.h"

extern "C" {
#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>
#include <apriltag/tagStandard41h12.h>
}

#include <algorithm>
#include <cmath>

namespace countershade::capture {

Mask grey8(const Image& photo) {
  const Image grey = luminance_mean(photo);
  std::vector<float> sorted;
  for (float v : grey.data())
    if (std::isfinite(v)) sorted.push_back(v);
  Mask picture(grey.width(), grey.height(), 1, 0);
  if (sorted.empty()) return picture;
  const std::size_t rank = sorted.size() - 1 - sorted.size() / 1000;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(rank), sorted.end());
  const float scale = sorted[rank] > 0 ? 255 / sorted[rank] : 1;
  for (std::size_t i = 0; i < grey.data().size(); ++i) {
    const float v = scale * grey.data()[i];
    picture.data()[i] = v > 0 ? static_cast<std::uint8_t>(std::lround(std::min(v, 255.f))) : 0;  // a NaN becomes 0
  }
  return picture;
}

std::vector<Tag> find_tags(const Mask& grey, TagFamily which) {
  const bool is_36h11 = which == TagFamily::k36h11;
  apriltag_family_t* family = is_36h11 ? tag36h11_create() : tagStandard41h12_create();
  apriltag_detector_t* detector = apriltag_detector_create();
  apriltag_detector_add_family_bits(detector, family, 1);
  detector->quad_decimate = grey.pixels() > 6'000'000 ? 2 : 1;
  detector->nthreads = 1;
  image_u8_t picture{.width = grey.width(),
                     .height = grey.height(),
                     .stride = grey.width(),
                     .buf = const_cast<std::uint8_t*>(grey.data().data())};
  zarray_t* found = apriltag_detector_detect(detector, &picture);
  std::vector<Tag> tags;
  for (int i = 0; i < zarray_size(found); ++i) {
    apriltag_detection_t* seen = nullptr;
    zarray_get(found, i, &seen);
    Tag tag{seen->id, {}};
    // The library begins at the bottom left and goes to the bottom right; its pixels begin at the corner.
    for (int k = 0; k < 4; ++k) tag.corners[k] = {seen->p[3 - k][0] - 0.5, seen->p[3 - k][1] - 0.5};
    tags.push_back(tag);
  }
  apriltag_detections_destroy(found);
  apriltag_detector_destroy(detector);
  is_36h11 ? tag36h11_destroy(family) : tagStandard41h12_destroy(family);
  return tags;
}

Mask modules_41h12(int id) {
  CS_CHECK(id >= 0 && id < k41h12Ids, "a tag of the family");
  apriltag_family_t* family = tagStandard41h12_create();
  CS_CHECK(family->total_width == k41h12Modules && family->width_at_border == k41h12Modules - 2 * k41h12Border &&
               family->reversed_border && static_cast<int>(family->ncodes) == k41h12Ids,
           "the family Standard41h12");
  Mask modules(k41h12Modules, k41h12Modules, 1, 0);
  const int last = k41h12Modules - 1 - k41h12Border;
  for (int i = k41h12Border; i <= last; ++i)  // a white border
    modules.at(i, k41h12Border) = modules.at(i, last) = modules.at(k41h12Border, i) = modules.at(last, i) = 1;
  for (std::uint32_t k = 0; k < family->nbits; ++k)
    modules.at(static_cast<int>(family->bit_x[k]) + k41h12Border, static_cast<int>(family->bit_y[k]) + k41h12Border) =
        (family->codes[id] >> (family->nbits - 1 - k)) & 1;
  tagStandard41h12_destroy(family);
  return modules;
}

}  // namespace countershade::capture
