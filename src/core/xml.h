#pragma once

#include <string>
#include <string_view>

namespace lapseam {

/// Text as content of an XML element, or between double quotes. Control characters, which XML cannot hold, become
/// blanks.
inline std::string escape_xml(std::string_view text) {
  std::string out;
  for (const char c : text) {
    if (c == '&')
      out += "&amp;";
    else if (c == '<')
      out += "&lt;";
    else if (c == '>')
      out += "&gt;";
    else if (c == '"')
      out += "&quot;";
    else
      out += c >= 0 && c < ' ' ? ' ' : c;
  }
  return out;
}

}  // namespace lapseam
