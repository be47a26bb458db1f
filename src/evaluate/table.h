#pragma once

#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <string_view>

namespace lapseam {

inline constexpr double kMmPerM = 1e3;
inline constexpr double kDegPerRad = 180 / std::numbers::pi;

inline double percent(std::uint64_t part, std::uint64_t whole) {
  return whole == 0 ? 0 : 100 * double(part) / double(whole);
}

/// Lines of the form "  name            value".
class Table {
 public:
  void head(std::string_view title) { text_ += fmt::format("{}\n", title); }
  void line(std::string_view name, const std::string& value) { text_ += fmt::format("  {:<28}{:>14}\n", name, value); }
  void mm(std::string_view name, double m) {
    line(name, std::isfinite(m) ? fmt::format("{:.3f} mm", kMmPerM * m) : "-");
  }
  void metres(std::string_view name, double m) { line(name, fmt::format("{:.3f} m", m)); }
  void share(std::string_view name, double x) { line(name, fmt::format("{:.3f} %", 100 * x)); }
  void share(std::string_view name, std::uint64_t part, std::uint64_t whole) {
    line(name, fmt::format("{:.3f} %", percent(part, whole)));
  }
  void count(std::string_view name, std::uint64_t n) { line(name, fmt::format("{}", n)); }
  void degrees(std::string_view name, double rad) { line(name, fmt::format("{:.3f} °", kDegPerRad * rad)); }
  void text(std::string_view text) { text_ += text; }
  std::string take() { return std::move(text_); }

 private:
  std::string text_;
};

struct BoundaryFigures;
void add_boundary(Table& table, std::string_view title, const BoundaryFigures& boundary);

}  // namespace lapseam
