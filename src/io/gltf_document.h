#pragma once

// The parts of a GLB file, each access checked: JSON, buffer views, accessors, images.

#include <cstdint>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

namespace lapseam {

/// Numbers in the binary chunk, all inside the file.
class GltfAccessor {
 public:
  std::size_t count() const { return count_; }
  int components() const { return components_; }
  /// Component `component` of element `index`; integers that are marked as normalised come as 0…1 or −1…1.
  double value(std::size_t index, int component) const;
  /// For indices: the integer as it is.
  std::uint32_t integer(std::size_t index) const;
  bool is_integer() const { return component_type_ != 5126; }

 private:
  friend class GltfDocument;
  const char* data_ = nullptr;
  std::size_t stride_ = 0;
  std::size_t count_ = 0;
  int components_ = 0;
  int component_type_ = 0;
  bool is_normalized_ = false;
};

class GltfDocument {
 public:
  /// Throws InvalidInput when it is not a glTF 2.0 binary, or needs an extension that is not known here.
  GltfDocument(const std::filesystem::path& file, std::span<const char> bytes);

  const nlohmann::json& root() const { return root_; }
  std::size_t file_bytes() const { return file_bytes_; }
  const std::filesystem::path& file() const { return file_; }

  /// Element `index` of a top-level array ("meshes", "nodes", …).
  const nlohmann::json& item(const char* array, std::uint64_t index) const;
  /// A non-negative integer, or `fallback` when the key is missing.
  std::uint64_t integer(const nlohmann::json& object, const char* key, std::uint64_t fallback) const;
  /// A non-negative integer that has to be there.
  std::uint64_t integer(const nlohmann::json& object, const char* key) const;
  /// An array of finite numbers of this length, written to out; false when the key is missing.
  bool numbers(const nlohmann::json& object, const char* key, std::span<double> out) const;

  GltfAccessor accessor(std::uint64_t index) const;
  std::span<const char> buffer_view(std::uint64_t index) const;
  /// Encoded bytes of an image that lies inside the file.
  std::span<const char> image_bytes(std::uint64_t index) const;

  [[noreturn]] void fail(const std::string& field, const std::string& problem) const;

 private:
  void check_extensions() const;
  std::span<const char> unpacked_view(std::uint64_t index, const nlohmann::json& extension) const;

  std::filesystem::path file_;
  std::size_t file_bytes_;
  nlohmann::json root_;
  std::span<const char> binary_;
  mutable std::map<std::uint64_t, std::vector<char>> unpacked_;  // of compressed buffer views
};

}  // namespace lapseam
