#pragma once

// A folder that appears under its name when it is complete, as OutputFile does for files.

#include <filesystem>

namespace lapseam {

class OutputFolder {
 public:
  /// Refuses an existing folder that is not empty, unless it was written by this class. What an interrupted run has
  /// left is removed.
  explicit OutputFolder(const std::filesystem::path& folder);
  ~OutputFolder();
  OutputFolder(const OutputFolder&) = delete;
  OutputFolder& operator=(const OutputFolder&) = delete;

  /// Where to write.
  const std::filesystem::path& path() const { return temporary_; }
  void commit();

 private:
  std::filesystem::path target_, temporary_;
  bool is_committed_ = false;
};

}  // namespace lapseam
