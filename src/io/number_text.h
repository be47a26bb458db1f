#pragma once

#include <charconv>
#include <string>

namespace lapseam {

/// The shortest text that reads back as the same number, whatever the locale.
inline std::string number_text(double value) {
  char digits[32];
  return {digits, std::to_chars(digits, digits + sizeof digits, value).ptr};
}

}  // namespace lapseam
