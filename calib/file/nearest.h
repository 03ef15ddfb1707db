// Which of the valid names somebody meant.
#pragma once

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

namespace countershade {

// Edit distance: insertions, removals and replacements of one character (Levenshtein 1966).
inline int edit_distance(std::string_view a, std::string_view b) {
  std::vector<int> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = static_cast<int>(j);
  for (std::size_t i = 1; i <= a.size(); ++i) {
    int diagonal = row[0];
    row[0] = static_cast<int>(i);
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const int replaced = diagonal + (a[i - 1] != b[j - 1]);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, replaced});
    }
  }
  return row[b.size()];
}

// The first of the valid names with the smallest distance; `valid` is not empty.
inline std::string nearest(std::string_view name, const std::vector<std::string>& valid) {
  return *std::min_element(valid.begin(), valid.end(), [&](const std::string& a, const std::string& b) {
    return edit_distance(name, a) < edit_distance(name, b);
  });
}

}  // namespace countershade
