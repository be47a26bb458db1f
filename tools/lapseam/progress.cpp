#include "progress.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>

namespace lapseam::tool {
namespace {

constexpr double kPlainIntervalS = 5;
constexpr int kDefaultColumns = 80;

std::string_view environment(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

int terminal_columns(std::FILE* stream) {
  winsize size{};
  if (ioctl(fileno(stream), TIOCGWINSZ, &size) == 0 && size.ws_col > 0) return size.ws_col;
  const int columns = std::atoi(std::string(environment("COLUMNS")).c_str());
  return columns > 0 ? columns : kDefaultColumns;
}

/// 12345678 -> "12.3M".
std::string short_count(double count) {
  constexpr std::array<const char*, 4> kSuffixes = {"", "k", "M", "G"};
  std::size_t i = 0;
  while (count >= 1000 && i + 1 < kSuffixes.size()) {
    count /= 1000;
    ++i;
  }
  const bool fraction = count < 100 && (i > 0 || count != std::uint64_t(count));
  return fmt::format("{:.{}f}{}", count, fraction ? 1 : 0, kSuffixes[i]);
}

std::string clock_text(double seconds) {
  const auto whole = std::uint64_t(std::llround(std::max(0.0, seconds)));
  if (whole >= 3600) return fmt::format("{}:{:02}:{:02}", whole / 3600, whole / 60 % 60, whole % 60);
  return fmt::format("{}:{:02}", whole / 60, whole % 60);
}

std::string amount_text(std::uint64_t done, std::uint64_t total) {
  if (total) return fmt::format("{}/{}", done, total);
  return done ? fmt::format("{}", done) : "";
}

std::string finished_text(const Progress& event) {
  const std::string amount = event.done ? short_count(double(event.done)) : "";
  return fmt::format("{:<20} {:>8} {:>9.2f} s", event.stage, amount, event.seconds);
}

void write_line(std::FILE* stream, std::string_view text) {
  // One call, so that lines of two processes on one terminal do not mix.
  const std::string line = std::string(text) + '\n';
  std::fwrite(line.data(), 1, line.size(), stream);
  std::fflush(stream);
}

}  // namespace

ProgressStyle resolve_progress_style(std::string_view name) {
  if (name == "bar") return ProgressStyle::kBar;
  if (name == "plain") return ProgressStyle::kPlain;
  if (name == "json") return ProgressStyle::kJson;
  if (name == "none") return ProgressStyle::kNone;
  const std::string_view terminal = environment("TERM");
  const bool rewrites = isatty(STDERR_FILENO) && !terminal.empty() && terminal != "dumb";
  return rewrites ? ProgressStyle::kBar : ProgressStyle::kPlain;
}

ProgressWriter::ProgressWriter(ProgressStyle style, std::FILE* stream)
    : style_(style), stream_(stream), colored_(isatty(fileno(stream)) && environment("NO_COLOR").empty()) {}

ProgressWriter::~ProgressWriter() { clear_bar(); }

void ProgressWriter::on_progress(const Progress& event) {
  if (style_ == ProgressStyle::kNone) return;
  if (style_ == ProgressStyle::kJson) return write_json(event);
  const std::size_t depth = stack_.size();
  update_stack(event);
  const bool begins = stack_.size() > depth;
  const bool outermost = begins ? depth == 0 : stack_.empty() || stack_.front().name == event.stage;
  if (style_ == ProgressStyle::kPlain) {
    write_plain(event, outermost, begins);
  } else {
    write_bar(event, outermost);
  }
}

void ProgressWriter::on_warning(std::string_view message) {
  if (style_ == ProgressStyle::kJson) {
    return write_line(stream_, nlohmann::json{{"event", "warning"}, {"message", message}}.dump(
                                   -1, ' ', false, nlohmann::json::error_handler_t::replace));
  }
  const bool redraw = bar_shown_;
  clear_bar();
  const char* label = colored_ ? "\x1b[33mwarning:\x1b[0m" : "warning:";
  write_line(stream_, fmt::format("lapseam: {} {}", label, message));
  if (redraw) draw_bar();
}

/// Pushes a stage that begins, pops one that has finished (and what it left unfinished when an exception ended it).
void ProgressWriter::update_stack(const Progress& event) {
  // The innermost of that name: a stage may contain another of the same name.
  auto found = std::find_if(stack_.rbegin(), stack_.rend(), [&](const Stage& s) { return s.name == event.stage; });
  const bool known = found != stack_.rend();
  if (event.finished) {
    if (known) stack_.erase(std::prev(found.base()), stack_.end());
    return;
  }
  const bool begins = event.done == 0 && event.seconds == 0.0;
  if (begins || !known) {
    stack_.push_back({std::string(event.stage), event.done, event.total, event.seconds});
  } else {
    *found = {std::string(event.stage), event.done, event.total, event.seconds};
  }
}

void ProgressWriter::write_plain(const Progress& event, bool outermost, bool begins) {
  if (outermost && begins) {
    next_plain_s_ = kPlainIntervalS;
    return write_line(stream_, fmt::format("{} ...", event.stage));
  }
  if (outermost && event.finished) return write_finished(event);
  if (stack_.empty()) return;
  const Stage& stage = stack_.front();
  if (stage.seconds < next_plain_s_) return;
  next_plain_s_ = stage.seconds + kPlainIntervalS;
  write_line(stream_, describe_running(stage));
}

void ProgressWriter::write_bar(const Progress& event, bool outermost) {
  if (!(outermost && event.finished)) return draw_bar();
  clear_bar();
  write_finished(event);
}

/// A stage that an exception ended says nothing: the exception will.
void ProgressWriter::write_finished(const Progress& event) const {
  if (event.done >= event.total) write_line(stream_, finished_text(event));
}

void ProgressWriter::write_json(const Progress& event) const {
  const bool begins = event.done == 0 && event.seconds == 0.0 && !event.finished;
  nlohmann::ordered_json line;
  line["event"] = event.finished ? "end" : begins ? "begin" : "progress";
  line["stage"] = event.stage;
  line["done"] = event.done;
  if (event.total) line["total"] = event.total;
  line["seconds"] = event.seconds;
  write_line(stream_, line.dump());
}

/// "triangulate 12/100 (12 %), 35.1/s, 0:03 left".
std::string ProgressWriter::describe_running(const Stage& stage) const {
  std::string text = stage.name;
  const std::string amount = amount_text(stage.done, stage.total);
  if (!amount.empty()) text += " " + amount;
  if (stage.total) text += fmt::format(" ({:.0f} %)", 100.0 * double(stage.done) / double(stage.total));
  if (stage.done && stage.seconds > 0) {
    const double rate = double(stage.done) / stage.seconds;
    text += fmt::format(", {}/s", short_count(rate));
    if (stage.total > stage.done) text += fmt::format(", {} left", clock_text(double(stage.total - stage.done) / rate));
  } else if (stage.seconds >= 1) {
    text += fmt::format(", {}", clock_text(stage.seconds));
  }
  if (stack_.size() > 1) text += fmt::format(" [{}]", stack_.back().name);
  return text;
}

void ProgressWriter::draw_bar() {
  if (stack_.empty()) return;
  const Stage& stage = stack_.front();
  const auto columns = std::size_t(terminal_columns(stream_) - 1);  // the last column would wrap on some terminals
  std::string text = describe_running(stage);
  constexpr std::size_t kWidestBar = 30, kNarrowestBar = 10;
  if (stage.total && text.size() + kNarrowestBar + 3 <= columns) {
    const std::size_t width = std::min(kWidestBar, columns - text.size() - 3);
    const auto filled = std::size_t(double(width) * std::min(1.0, double(stage.done) / double(stage.total)));
    const std::string full(filled, '='), open(width - filled, ' ');
    const std::string bar =
        colored_ ? fmt::format("[\x1b[32m{}\x1b[0m{}]", full, open) : fmt::format("[{}{}]", full, open);
    text = bar + " " + text;
  } else {
    text.resize(std::min(text.size(), columns));
  }
  text = "\r\x1b[K" + text;
  std::fwrite(text.data(), 1, text.size(), stream_);
  std::fflush(stream_);
  bar_shown_ = true;
}

void ProgressWriter::clear_bar() {
  if (!bar_shown_) return;
  std::fputs("\r\x1b[K", stream_);
  std::fflush(stream_);
  bar_shown_ = false;
}

}  // namespace lapseam::tool
