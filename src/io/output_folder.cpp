#include "io/output_folder.h"

#include <fcntl.h>
#include <stdio.h>

#include <cerrno>
#include <fstream>
#include <system_error>

#include "lapseam/error.h"

namespace lapseam {
namespace {

namespace fs = std::filesystem;

// Says that the folder may be replaced as a whole.
constexpr const char* kMark = ".written-by-lapseam";

fs::path without_trailing_slash(const fs::path& folder) {
  const fs::path normal = fs::absolute(folder).lexically_normal();
  return normal.has_filename() ? normal : normal.parent_path();
}

}  // namespace

OutputFolder::OutputFolder(const fs::path& folder) : target_(without_trailing_slash(folder)) {
  std::error_code error;
  const fs::file_status status = fs::status(target_, error);
  if (fs::exists(status) && !fs::is_directory(status)) throw IoError(folder, "cannot write: this is no folder");
  if (fs::is_directory(status) && !fs::is_empty(target_, error) && !fs::exists(target_ / kMark, error))
    throw IoError(folder, "cannot write: this folder is not empty, and was not written by lapseam convert");
  temporary_ = target_;
  temporary_.replace_filename("." + target_.filename().string() + ".part");
  fs::remove_all(temporary_, error);
  fs::create_directories(temporary_, error);
  if (error) throw IoError(folder, "cannot write: " + error.message());
  if (!std::ofstream(temporary_ / kMark)) throw IoError(folder, "cannot write");
}

OutputFolder::~OutputFolder() {
  std::error_code ignored;
  if (!is_committed_) fs::remove_all(temporary_, ignored);
}

void OutputFolder::commit() {
  std::error_code error;
  if (!fs::exists(target_, error)) {
    fs::rename(temporary_, target_, error);
  } else {
    // Both names change hands at one moment, so that there is always a whole folder under the target's.
    if (renameat2(AT_FDCWD, temporary_.c_str(), AT_FDCWD, target_.c_str(), RENAME_EXCHANGE) != 0)
      error = std::error_code(errno, std::generic_category());
  }
  if (error) throw IoError(target_, "cannot rename the finished folder: " + error.message());
  is_committed_ = true;
  fs::remove_all(temporary_, error);
}

}  // namespace lapseam
