#pragma once

// What every stage shares while it runs: worker threads, cancel flag, progress, warnings, time and memory per stage.
// Nothing here touches process-wide state; two contexts may work side by side.

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace lapseam {

/// One finished stage: what it cost.
struct StageRecord {
  std::string name;
  double seconds = 0;
  /// Peak resident memory of the process while the stage ran, as the operating system counts it; 0 if unknown.
  std::uint64_t peak_rss_bytes = 0;
};

/// One progress event. `done` of `total` units of `stage`; total 0 means that the amount is not known.
struct Progress {
  std::string_view stage;
  std::uint64_t done = 0;
  std::uint64_t total = 0;
  double seconds = 0;     ///< since the stage began
  bool finished = false;  ///< the stage's last event
};

/// What the process may take of the machine's memory.
struct MemoryBudget {
  std::uint64_t bytes = 0;       ///< resident memory of the whole process; 0: no limit
  std::filesystem::path folder;  ///< for what does not fit; empty: the system's folder for temporary files
};

/// What the budget did.
struct MemoryUse {
  std::uint64_t budget_bytes = 0;          ///< 0: there was none
  std::uint64_t largest_stored_bytes = 0;  ///< most that lay in the temporary file at once
  std::uint64_t evictions = 0;             ///< how often what had been read was given back
};

/// Owns the worker threads and the sinks. Not copyable. All members may be called from worker threads.
class Context {
 public:
  /// `threads` 0 means as many as the machine has.
  explicit Context(int threads = 0);
  ~Context();
  Context(const Context&) = delete;
  Context& operator=(const Context&) = delete;

  int threads() const;

  /// Asks all work under this context to stop; the running stage throws Cancelled soon after. Async-signal-safe.
  void cancel() noexcept { cancelled_.store(true, std::memory_order_relaxed); }
  bool is_cancelled() const noexcept { return cancelled_.load(std::memory_order_relaxed); }
  /// Throws Cancelled when cancel() was called.
  void throw_if_cancelled() const;

  /// Called at most about ten times a second per stage, one call at a time. Empty: no progress.
  void set_progress_sink(std::function<void(const Progress&)> sink);
  /// Called for each warning, one call at a time. Warnings are kept either way, see warnings().
  void set_warning_sink(std::function<void(std::string_view)> sink);

  /// From now on images live in a temporary file, which is mapped into memory: what has been read of it is given back
  /// whenever the process would take more than the budget. The file has no name; it is gone when the process is. Once
  /// for a context, before its work begins. Throws IoError where there can be no such file.
  void set_memory_budget(const MemoryBudget& budget);
  MemoryUse memory_use() const;

  void warn(std::string message);
  std::vector<std::string> warnings() const;
  std::vector<StageRecord> stages() const;

  struct Impl;
  Impl& impl() const { return *impl_; }  ///< for lapseam's own parallel loops

 private:
  std::unique_ptr<Impl> impl_;
  std::atomic<bool> cancelled_{false};
};

/// For programs, not for libraries: lets contexts of this process have up to `threads` threads, where that is more than
/// the machine has processors. Without it they get fewer than they asked for. The one process-wide switch there is.
void allow_threads(int threads);

/// Marks a stage while it lives: times it, records memory, reports progress. Stages of the same name add up.
class StageScope {
 public:
  StageScope(Context& context, std::string name, std::uint64_t total_units = 0);
  ~StageScope();
  StageScope(const StageScope&) = delete;
  StageScope& operator=(const StageScope&) = delete;

  /// Adds finished units; thread-safe; throws Cancelled when asked to stop.
  void advance(std::uint64_t units = 1);

 private:
  Context& context_;
  std::string name_;
  std::uint64_t total_;
  std::atomic<std::uint64_t> done_{0};
  int exceptions_;  ///< in flight when the stage began: more at its end mean that it failed
  std::int64_t start_ns_;
  std::atomic<std::int64_t> next_report_ns_;
};

}  // namespace lapseam
