#pragma once

// Strict reading of JSON objects: every key must be known, every value of the right type, and every error names the
// file, the view, and the path of the key.

#include <Eigen/Geometry>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "io/source.h"

namespace lapseam {

/// Parses a whole file. Syntax errors and duplicate keys are InvalidInput with line and column. The bare words NaN and
/// Infinity, which JSON has not but some programs write, become strings, so that the reader of the value can name it.
nlohmann::json parse_json_file(const std::filesystem::path& file);

/// One object of a document. The document must outlive it.
class JsonObject {
 public:
  /// Refuses a value that is no object, and keys that are not in `known`. `path` is where the object is: "range", say.
  JsonObject(const nlohmann::json& value, Source source, std::string path, std::initializer_list<const char*> known);

  bool has(const char* key) const { return value_.contains(key); }
  /// Refuses a missing key.
  const nlohmann::json& at(const char* key) const;
  std::string path_of(const std::string& key) const { return path_.empty() ? key : path_ + "." + key; }
  const Source& source() const { return source_; }

  double number(const char* key) const;  ///< always finite
  double number_or(const char* key, double missing) const { return has(key) ? number(key) : missing; }
  double positive(const char* key) const;
  int size_px(const char* key) const;  ///< an integer from 1 to 2^30
  std::string text(const char* key) const;
  std::vector<double> numbers(const char* key) const;
  /// A rigid 4 × 4 matrix, rows first; its translation is multiplied by `unit_m`.
  Eigen::Isometry3d pose(const char* key, double unit_m) const;

  [[noreturn]] void refuse(const std::string& key, const std::string& problem) const {
    source_.refuse(path_of(key), problem);
  }

 private:
  const nlohmann::json& value_;
  Source source_;
  std::string path_;
};

/// The name out of `names` that a typing error most likely meant; empty when none is near.
std::string nearest_name(std::string_view word, const std::vector<std::string>& names);

}  // namespace lapseam
