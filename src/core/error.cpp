#include "lapseam/error.h"

namespace lapseam {
namespace {

std::string describe(const std::filesystem::path& file, const std::string& view, const std::string& field,
                     const std::string& problem) {
  std::string text;
  if (!file.empty()) text += file.string() + ": ";
  if (!view.empty()) text += "view '" + view + "': ";
  if (!field.empty()) text += field + ": ";
  return text + problem;
}

}  // namespace

InvalidInput::InvalidInput(const std::filesystem::path& file, const std::string& view, const std::string& field,
                           const std::string& problem)
    : Error(describe(file, view, field, problem)) {}

IoError::IoError(const std::filesystem::path& path, const std::string& problem)
    : Error(path.string() + ": " + problem) {}

Cancelled::Cancelled() : Error("cancelled") {}

}  // namespace lapseam
