#include "io/json_object.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include "io/output_file.h"
#include "io/rigid.h"

namespace lapseam {
namespace {

using nlohmann::json;

bool is_word_char(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '.';
}

/// Puts bare non-finite numbers into quotes; everything else is left to the parser.
std::string quote_non_finite(std::string_view text) {
  constexpr std::string_view kWords[] = {"NaN", "nan", "-NaN", "-nan", "Infinity", "-Infinity", "inf", "-inf"};
  std::string result;
  result.reserve(text.size() + 64);
  bool in_string = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (in_string && c == '\\' && i + 1 < text.size()) {
      result += c;
      result += text[++i];
      continue;
    }
    if (c == '"') in_string = !in_string;
    const bool begins_word = !in_string && (c == '-' || is_word_char(c)) && (i == 0 || !is_word_char(text[i - 1]));
    if (begins_word) {
      std::size_t end = i + 1;
      while (end < text.size() && is_word_char(text[end])) ++end;
      const std::string_view word = text.substr(i, end - i);
      const bool is_non_finite = std::find(std::begin(kWords), std::end(kWords), word) != std::end(kWords);
      result += is_non_finite ? '"' + std::string(word) + '"' : std::string(word);
      i = end - 1;
      continue;
    }
    result += c;
  }
  return result;
}

/// The part of a parser's message that is for users: without "[json.exception…]".
std::string strip_prefix(std::string message) {
  const std::size_t end = message.find("] ");
  if (message.starts_with('[') && end != std::string::npos) message.erase(0, end + 2);
  std::replace(message.begin(), message.end(), '\n', ' ');
  return message;
}

/// A short form of a value, for errors.
std::string show(const json& value) {
  const std::string text = value.dump(-1, ' ', false, json::error_handler_t::replace);
  return text.size() <= 40 ? text : text.substr(0, 37) + "...";
}

/// Optimal string alignment distance: insertions, deletions, changes, and swaps of neighbours (Damerau 1964).
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> before_last(b.size() + 1), last(b.size() + 1), row(b.size() + 1);
  std::iota(last.begin(), last.end(), std::size_t(0));
  for (std::size_t i = 1; i <= a.size(); ++i) {
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      row[j] = std::min({last[j] + 1, row[j - 1] + 1, last[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1)});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        row[j] = std::min(row[j], before_last[j - 2] + 1);
    }
    std::swap(before_last, last);
    std::swap(last, row);
  }
  return last[b.size()];
}

std::string lower(std::string_view text) {
  std::string result(text);
  for (char& c : result)
    if (c >= 'A' && c <= 'Z') c = char(c - 'A' + 'a');
  return result;
}

}  // namespace

std::string nearest_name(std::string_view word, const std::vector<std::string>& names) {
  if (word.size() > 64) return {};
  std::size_t best = std::max<std::size_t>(2, word.size() / 3) + 1;
  std::string nearest;
  for (const std::string& name : names) {
    // What was typed may be a part of a longer name ("scale" of "scale_m"), or differ in case only.
    const bool is_prefix = word.size() >= 3 && lower(name).starts_with(lower(word));
    const std::size_t distance = is_prefix ? 1 : edit_distance(lower(word), lower(name));
    if (distance < best) {
      best = distance;
      nearest = name;
    }
  }
  return nearest;
}

json parse_json_file(const std::filesystem::path& file) {
  const std::vector<char> bytes = read_file_bytes(file);
  const std::string text = quote_non_finite({bytes.data(), bytes.size()});
  // Keys of the objects that are open; the parser itself would let the last of two equal keys win.
  std::vector<std::set<std::string>> open_objects;
  const auto check_keys = [&](int, json::parse_event_t event, json& parsed) {
    if (event == json::parse_event_t::object_start) open_objects.emplace_back();
    if (event == json::parse_event_t::object_end) open_objects.pop_back();
    if (event == json::parse_event_t::key && !open_objects.back().insert(parsed.get<std::string>()).second)
      throw InvalidInput(file, {}, parsed.get<std::string>(), "this key appears twice in one object");
    return true;
  };
  try {
    return json::parse(text, check_keys);
  } catch (const json::exception& error) {
    throw InvalidInput(file, {}, {}, strip_prefix(error.what()));
  }
}

JsonObject::JsonObject(const json& value, Source source, std::string path, std::initializer_list<const char*> known)
    : value_(value), source_(std::move(source)), path_(std::move(path)) {
  if (!value.is_object()) source_.refuse(path_, "expected an object { }, found " + show(value));
  const std::vector<std::string> names(known.begin(), known.end());
  for (const auto& item : value.items()) {
    if (std::find(names.begin(), names.end(), item.key()) != names.end()) continue;
    const std::string nearest = nearest_name(item.key(), names);
    refuse(item.key(), "unknown key" + (nearest.empty() ? std::string() : "; did you mean '" + nearest + "'?"));
  }
}

const json& JsonObject::at(const char* key) const {
  if (!has(key)) refuse(key, "missing");
  return value_.at(key);
}

double JsonObject::number(const char* key) const {
  const json& value = at(key);
  if (!value.is_number()) refuse(key, "expected a number, found " + show(value));
  const double number = value.get<double>();
  if (!std::isfinite(number)) refuse(key, "is not finite");
  return number;
}

double JsonObject::positive(const char* key) const {
  const double value = number(key);
  if (!(value > 0)) refuse(key, "must be greater than 0, is " + show(at(key)));
  return value;
}

int JsonObject::size_px(const char* key) const {
  const json& value = at(key);
  const bool is_fine = value.is_number_integer() && value.get<double>() >= 1 && value.get<double>() <= double(1 << 30);
  if (!is_fine) refuse(key, "expected a number of pixels, 1 or more, found " + show(value));
  return value.get<int>();
}

std::string JsonObject::text(const char* key) const {
  const json& value = at(key);
  if (!value.is_string()) refuse(key, "expected a text in quotes, found " + show(value));
  std::string text = value.get<std::string>();
  if (text.empty()) refuse(key, "is empty");
  return text;
}

std::vector<double> JsonObject::numbers(const char* key) const {
  const json& value = at(key);
  if (!value.is_array()) refuse(key, "expected a list of numbers, found " + show(value));
  std::vector<double> numbers;
  numbers.reserve(value.size());
  for (std::size_t i = 0; i < value.size(); ++i) {
    const bool is_finite = value[i].is_number() && std::isfinite(value[i].get<double>());
    if (!is_finite)
      refuse(std::string(key) + "[" + std::to_string(i) + "]", "expected a number, found " + show(value[i]));
    numbers.push_back(value[i].get<double>());
  }
  return numbers;
}

Eigen::Isometry3d JsonObject::pose(const char* key, double unit_m) const {
  const json& rows = at(key);
  if (!rows.is_array() || rows.size() != 4) refuse(key, "expected 4 rows of 4 numbers");
  Eigen::Matrix4d matrix;
  for (std::size_t row = 0; row < 4; ++row) {
    const std::string row_key = std::string(key) + "[" + std::to_string(row) + "]";
    if (!rows[row].is_array() || rows[row].size() != 4) refuse(row_key, "expected 4 numbers");
    for (std::size_t column = 0; column < 4; ++column) {
      const json& value = rows[row][column];
      const bool is_finite = value.is_number() && std::isfinite(value.get<double>());
      if (!is_finite) refuse(row_key + "[" + std::to_string(column) + "]", "expected a number, found " + show(value));
      matrix(Eigen::Index(row), Eigen::Index(column)) = value.get<double>();
    }
  }
  Eigen::Isometry3d pose = to_rigid(matrix, source_, path_of(key));
  pose.translation() *= unit_m;
  return pose;
}

}  // namespace lapseam
