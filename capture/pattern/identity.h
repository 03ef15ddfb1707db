// Frame identity: pictures that somebody else shows say themselves which frame they are, by a tag in squares that they
// give up. A photo of them needs no name and no place in an order.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <string>
#include <vector>

#include "calib/base/result.h"
#include "calib/file/session.h"
#include "calib/image/image.h"

namespace countershade::capture {

// Where the marks of a projector are. Its picture's own corners often miss the screen.
struct MarkLayout {
  std::vector<std::string> corners = {"top-left", "bottom-right"};  // or top-right, bottom-left
  double inset = 0.2;  // between mark and picture's edge, of the picture's width and height
  int side_px = 0;     // edge of a mark; 0: a twelfth of the picture's height, 44 px at least
};
// Marks for every projector of the sequence. Errors: kBadValue for another corner, an inset outside 0 to .4, squares
// that are too small for a tag of 11 modules of 2 px or larger than half of the picture, and more pictures than there
// are tags.
Result<std::vector<IdentityMark>> identity_marks(const Sequence& sequence, const MarkLayout& layout);

// Draws the tag of projector `q` of the sequence in the frame at this place in it (0 = the first) into its squares.
void draw_identity(const Sequence& sequence, int q, int position, Picture& picture);

// A mark in a photo.
struct SeenMark {
  int position = 0;                        // of the frame in the sequence
  int projector = 0;                       // of the sequence
  Eigen::Vector2d centre;                  // [px]
  std::array<Eigen::Vector2d, 4> outline;  // of the whole square [px]
  Eigen::Matrix3d to_photo;                // from modules, (0, 0) the tag's top left corner, to pixels
};
// All marks of a sequence. photo: light, any scale, 1 or 3 channels.
std::vector<SeenMark> find_marks(const Image& photo, const Sequence& sequence);

// Share of the light in a mark that is another frame's: what a display that has not settled, or an exposure across a
// change, leaves of the one before or after. By least squares over the modules,
// blur of the own tag accounted for; at least 0.
double share_of(int other, const SeenMark& mark, const Image& photo, const Sequence& sequence);

}  // namespace countershade::capture
