#pragma once

// The exceptions lapseam throws. What can be expected of real data (a gap that could not be sewn, a view without
// overlap) is a line in the report; these are for what the caller must mend.

#include <filesystem>
#include <stdexcept>
#include <string>

namespace lapseam {

/// Base of everything thrown on purpose. what() is one line, fit for a user.
class Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The data say something that cannot be. Names the file, the view and the field; empty parts are left out of what().
class InvalidInput : public Error {
 public:
  InvalidInput(const std::filesystem::path& file, const std::string& view, const std::string& field,
               const std::string& problem);
};

/// A file cannot be opened, read, or written. Names the path.
class IoError : public Error {
 public:
  IoError(const std::filesystem::path& path, const std::string& problem);
};

/// The context's cancel flag was set while work was under way.
class Cancelled : public Error {
 public:
  Cancelled();
};

}  // namespace lapseam
