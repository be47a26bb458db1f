#pragma once

#include <CLI/CLI.hpp>
#include <sstream>
#include <string>

namespace lapseam::tool {

/// CLI11's help text made calmer: descriptions are broken at the width of a page (CLI11 itself indents what follows a
/// line break), and the limits and exclusions of options are left to the message that tells of a wrong one.
class HelpFormatter : public CLI::Formatter {
 public:
  HelpFormatter() { column_width(kNameColumns); }

  std::string make_option_desc(const CLI::Option* option) const override {
    return wrap(CLI::Formatter::make_option_desc(option));
  }

  std::string make_option_opts(const CLI::Option* option) const override {
    if (option->get_type_size() == 0) return "";
    const std::string type = option->get_type_name();
    std::string text = " " + type.substr(0, type.find(':'));
    if (!option->get_default_str().empty()) text += "=" + option->get_default_str();
    if (option->get_required()) text += " REQUIRED";
    return text;
  }

  std::string make_subcommand(const CLI::App* command) const override {
    std::ostringstream out;
    CLI::detail::format_help(out, command->get_name(), wrap(command->get_description()), get_column_width());
    return out.str();
  }

 private:
  static constexpr std::size_t kNameColumns = 32, kPageColumns = 100;

  static std::string wrap(const std::string& text) {
    std::istringstream words(text);
    std::string wrapped;
    std::size_t column = kNameColumns;
    for (std::string word; words >> word; column += word.size() + 1) {
      if (column + word.size() > kPageColumns && column > kNameColumns) {
        wrapped.back() = '\n';
        column = kNameColumns;
      }
      wrapped += word + ' ';
    }
    if (!wrapped.empty()) wrapped.pop_back();
    return wrapped;
  }
};

}  // namespace lapseam::tool
