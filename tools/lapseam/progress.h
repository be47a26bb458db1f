#pragma once

// Progress and warnings on stderr: a bar that is rewritten in place, plain lines, or JSON lines.

#include <cstdint>
#include <cstdio>
#include <string>
#include <string_view>
#include <vector>

#include "lapseam/context.h"

namespace lapseam::tool {

enum class ProgressStyle { kBar, kPlain, kJson, kNone };

/// `name` is auto, bar, plain, json or none. auto: a bar when stderr is a terminal that can rewrite a line, else plain.
ProgressStyle resolve_progress_style(std::string_view name);

/// Writes what a context's sinks receive. Not thread-safe: the context calls its sinks one at a time.
/// Stages may nest; a line belongs to the outermost one, and names the innermost beside it.
class ProgressWriter {
 public:
  ProgressWriter(ProgressStyle style, std::FILE* stream);
  /// Clears a bar that is still on the screen.
  ~ProgressWriter();
  ProgressWriter(const ProgressWriter&) = delete;
  ProgressWriter& operator=(const ProgressWriter&) = delete;

  void on_progress(const Progress& event);
  void on_warning(std::string_view message);

 private:
  struct Stage {
    std::string name;
    std::uint64_t done = 0;
    std::uint64_t total = 0;
    double seconds = 0;
  };

  void update_stack(const Progress& event);
  void write_plain(const Progress& event, bool outermost, bool begins);
  void write_bar(const Progress& event, bool outermost);
  void write_finished(const Progress& event) const;
  void write_json(const Progress& event) const;
  std::string describe_running(const Stage& stage) const;
  void draw_bar();
  void clear_bar();

  ProgressStyle style_;
  std::FILE* stream_;
  bool colored_ = false;
  bool bar_shown_ = false;
  double next_plain_s_ = 0;
  std::vector<Stage> stack_;
};

}  // namespace lapseam::tool
