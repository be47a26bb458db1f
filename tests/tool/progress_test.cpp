#include "progress.h"

#include <gtest/gtest.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>

namespace lapseam::tool {
namespace {

/// A writer on a scratch file, and what it wrote so far.
class Recorder {
 public:
  explicit Recorder(ProgressStyle style)
      : file_(std::tmpfile()), writer_(std::make_unique<ProgressWriter>(style, file_)) {}
  ~Recorder() {
    writer_.reset();
    std::fclose(file_);
  }
  ProgressWriter& writer() { return *writer_; }
  void finish() { writer_.reset(); }
  std::string text() const {
    std::rewind(file_);
    std::string all;
    for (int c = std::fgetc(file_); c != EOF; c = std::fgetc(file_)) all.push_back(char(c));
    return all;
  }
  std::vector<std::string> lines() const {
    std::istringstream stream(text());
    std::vector<std::string> all;
    for (std::string line; std::getline(stream, line);) all.push_back(line);
    return all;
  }

 private:
  std::FILE* file_;
  std::unique_ptr<ProgressWriter> writer_;
};

/// What a terminal shows after the text: each line as rewritten last.
std::vector<std::string> screen(const std::string& text) {
  std::vector<std::string> lines(1);
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text.compare(i, 4, "\r\x1b[K") == 0) {
      lines.back().clear();
      i += 3;
    } else if (text[i] == '\n') {
      lines.emplace_back();
    } else {
      lines.back().push_back(text[i]);
    }
  }
  return lines;
}

TEST(Progress, PlainWritesOneLineAtTheBeginningAndTheEndOfAStage) {
  Recorder recorder(ProgressStyle::kPlain);
  recorder.writer().on_progress({"triangulate", 0, 100, 0.0, false});
  recorder.writer().on_progress({"triangulate", 50, 100, 1.0, false});
  recorder.writer().on_progress({"triangulate", 100, 100, 2.0, true});
  ASSERT_EQ(recorder.lines().size(), 2u);
  EXPECT_EQ(recorder.lines()[0], "triangulate ...");
  EXPECT_NE(recorder.lines()[1].find("2.00 s"), std::string::npos);
}

TEST(Progress, PlainWritesALongStageEveryFiveSeconds) {
  Recorder recorder(ProgressStyle::kPlain);
  recorder.writer().on_progress({"sew", 0, 100, 0.0, false});
  for (int tenth = 1; tenth <= 160; ++tenth) {
    recorder.writer().on_progress({"sew", std::uint64_t(tenth / 2), 100, tenth * 0.1, false});
  }
  recorder.writer().on_progress({"sew", 100, 100, 16.1, true});
  ASSERT_EQ(recorder.lines().size(), 5u) << recorder.text();  // begin, 5 s, 10 s, 15 s, end
  EXPECT_EQ(recorder.lines()[2], "sew 50/100 (50 %), 5/s, 0:10 left");
}

TEST(Progress, NestedStagesAreShownWithinTheirOutermostStage) {
  Recorder recorder(ProgressStyle::kPlain);
  auto& writer = recorder.writer();
  writer.on_progress({"integrate", 0, 10, 0.0, false});
  for (int view = 1; view <= 3; ++view) {
    writer.on_progress({"overlap", 0, 0, 0.0, false});
    if (view == 3) writer.on_progress({"integrate", 3, 10, 6.0, false});
    writer.on_progress({"overlap", 0, 0, 0.5, true});
  }
  writer.on_progress({"integrate", 10, 10, 9.0, true});
  ASSERT_EQ(recorder.lines().size(), 3u) << recorder.text();
  EXPECT_EQ(recorder.lines()[1], "integrate 3/10 (30 %), 0.5/s, 0:14 left [overlap]");
}

TEST(Progress, BarIsRewrittenInPlaceAndLeavesOneLineAStage) {
  Recorder recorder(ProgressStyle::kBar);
  auto& writer = recorder.writer();
  writer.on_progress({"load", 0, 4, 0.0, false});
  for (std::uint64_t done = 1; done <= 4; ++done) writer.on_progress({"load", done, 4, double(done), false});
  writer.on_progress({"load", 4, 4, 4.5, true});
  EXPECT_NE(recorder.text().find("[===============               ] load 2/4 (50 %), 1/s, 0:02 left"), std::string::npos)
      << recorder.text();
  const auto lines = screen(recorder.text());
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_EQ(lines[0].substr(0, 5), "load ");
  EXPECT_EQ(lines[1], "");
}

TEST(Progress, BarGivesWayToAWarningAndComesBack) {
  Recorder recorder(ProgressStyle::kBar);
  recorder.writer().on_progress({"load", 0, 4, 0.0, false});
  recorder.writer().on_progress({"load", 1, 4, 1.0, false});
  recorder.writer().on_warning("view '7': no valid sample");
  const auto lines = screen(recorder.text());
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_EQ(lines[0], "lapseam: warning: view '7': no valid sample");
  EXPECT_NE(lines[1].find("load 1/4"), std::string::npos);
}

TEST(Progress, BarIsClearedWhenAnExceptionEndsTheWork) {
  Recorder recorder(ProgressStyle::kBar);
  recorder.writer().on_progress({"load", 0, 4, 0.0, false});
  recorder.finish();
  EXPECT_EQ(screen(recorder.text()), std::vector<std::string>{""});
}

TEST(Progress, BarNeverWrapsALine) {
  Recorder recorder(ProgressStyle::kBar);
  const std::string name(300, 'x');
  recorder.writer().on_progress({name, 0, 4, 0.0, false});
  recorder.writer().on_progress({name, 1, 4, 1.0, false});
  EXPECT_LE(screen(recorder.text()).back().size(), 79u);
}

TEST(Progress, JsonLinesAreObjectsInTheOrderOfEvents) {
  Recorder recorder(ProgressStyle::kJson);
  recorder.writer().on_progress({"load", 0, 4, 0.0, false});
  recorder.writer().on_warning("a \"quoted\" name and a bad byte \xff");
  recorder.writer().on_progress({"load", 4, 4, 4.5, true});
  std::vector<std::string> events;
  for (const std::string& line : recorder.lines()) events.push_back(nlohmann::json::parse(line).at("event"));
  EXPECT_EQ(events, (std::vector<std::string>{"begin", "warning", "end"}));
}

TEST(Progress, NoneIsSilentButForWarnings) {
  Recorder recorder(ProgressStyle::kNone);
  recorder.writer().on_progress({"load", 0, 4, 0.0, false});
  recorder.writer().on_progress({"load", 4, 4, 4.5, true});
  EXPECT_EQ(recorder.text(), "");
  recorder.writer().on_warning("view '7' left out");
  EXPECT_EQ(recorder.text(), "lapseam: warning: view '7' left out\n");
}

TEST(Progress, AStageThatFailsIsNotShownAsDone) {
  Recorder recorder(ProgressStyle::kPlain);
  Context context(1);
  context.set_progress_sink([&](const lapseam::Progress& event) { recorder.writer().on_progress(event); });
  try {
    StageScope stage(context, "load", 3);
    stage.advance();
    throw std::runtime_error("a bad view");
  } catch (const std::runtime_error&) {
  }
  EXPECT_EQ(recorder.text(), "load ...\n");
}

TEST(Progress, AContextDrivesTheWriter) {
  Recorder recorder(ProgressStyle::kPlain);
  Context context(2);
  context.set_progress_sink([&](const Progress& event) { recorder.writer().on_progress(event); });
  {
    StageScope outer(context, "outer", 2);
    outer.advance();
    const StageScope inner(context, "inner");
  }
  ASSERT_EQ(recorder.lines().size(), 2u) << recorder.text();
  EXPECT_EQ(recorder.lines()[0], "outer ...");
}

}  // namespace
}  // namespace lapseam::tool
