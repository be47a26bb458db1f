#include "lapseam/context.h"

#include <chrono>
#include <exception>
#include <memory>
#include <mutex>
#include <thread>

#include "core/memory.h"
#include "core/parallel.h"
#include "core/spill_file.h"
#include "lapseam/error.h"

namespace lapseam {
namespace {

constexpr std::int64_t kReportIntervalNs = 100'000'000;

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

}  // namespace

struct Context::Impl {
  explicit Impl(int threads) : arena(threads) {}
  tbb::task_arena arena;
  mutable std::mutex mutex;
  std::function<void(const Progress&)> progress_sink;
  std::function<void(std::string_view)> warning_sink;
  std::vector<std::string> warnings;
  std::vector<StageRecord> stages;
  std::shared_ptr<SpillFile> spill_file;
};

tbb::task_arena& arena_of(Context& context) { return context.impl().arena; }

std::shared_ptr<SpillFile> spill_file_of(const Context& context) { return context.impl().spill_file; }

Context::Context(int threads)
    : impl_(std::make_unique<Impl>(threads > 0 ? threads : int(std::max(1u, std::thread::hardware_concurrency())))) {}
Context::~Context() = default;

void allow_threads(int threads) {
  static std::mutex mutex;
  static std::unique_ptr<tbb::global_control> limit;
  const std::scoped_lock lock(mutex);
  const auto wanted = std::size_t(std::max(threads, 1));
  if (wanted <= tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism)) return;
  limit = std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism, wanted);
}

int Context::threads() const { return impl_->arena.max_concurrency(); }

void Context::throw_if_cancelled() const {
  if (is_cancelled()) throw Cancelled();
}

void Context::set_progress_sink(std::function<void(const Progress&)> sink) {
  const std::scoped_lock lock(impl_->mutex);
  impl_->progress_sink = std::move(sink);
}

void Context::set_warning_sink(std::function<void(std::string_view)> sink) {
  const std::scoped_lock lock(impl_->mutex);
  impl_->warning_sink = std::move(sink);
}

void Context::set_memory_budget(const MemoryBudget& budget) {
  impl_->spill_file = budget.bytes > 0 ? std::make_shared<SpillFile>(budget) : nullptr;
}

MemoryUse Context::memory_use() const { return impl_->spill_file ? impl_->spill_file->use() : MemoryUse{}; }

void Context::warn(std::string message) {
  const std::scoped_lock lock(impl_->mutex);
  if (impl_->warning_sink) impl_->warning_sink(message);
  impl_->warnings.push_back(std::move(message));
}

std::vector<std::string> Context::warnings() const {
  const std::scoped_lock lock(impl_->mutex);
  return impl_->warnings;
}

std::vector<StageRecord> Context::stages() const {
  const std::scoped_lock lock(impl_->mutex);
  return impl_->stages;
}

StageScope::StageScope(Context& context, std::string name, std::uint64_t total_units)
    : context_(context),
      name_(std::move(name)),
      total_(total_units),
      exceptions_(std::uncaught_exceptions()),
      start_ns_(now_ns()),
      next_report_ns_(start_ns_ + kReportIntervalNs) {
  context_.throw_if_cancelled();
  auto& impl = context_.impl();
  const std::scoped_lock lock(impl.mutex);
  if (impl.progress_sink) impl.progress_sink({name_, 0, total_, 0.0});
}

StageScope::~StageScope() {
  const double seconds = double(now_ns() - start_ns_) * 1e-9;
  auto& impl = context_.impl();
  const std::scoped_lock lock(impl.mutex);
  if (impl.progress_sink && !context_.is_cancelled()) {
    const std::uint64_t done = done_.load();
    const bool failed = std::uncaught_exceptions() > exceptions_;
    impl.progress_sink({name_, total_ && !failed ? total_ : done, total_ ? total_ : done, seconds, true});
  }
  // The kernel's high-water mark only grows, so a stage's peak is an upper bound: the peak so far when it ended.
  const std::uint64_t peak = peak_rss_bytes();
  for (auto& record : impl.stages) {
    if (record.name == name_) {
      record.seconds += seconds;
      record.peak_rss_bytes = std::max(record.peak_rss_bytes, peak);
      return;
    }
  }
  impl.stages.push_back({name_, seconds, peak});
}

void StageScope::advance(std::uint64_t units) {
  context_.throw_if_cancelled();
  const std::uint64_t done = done_.fetch_add(units, std::memory_order_relaxed) + units;
  const std::int64_t now = now_ns();
  std::int64_t next = next_report_ns_.load(std::memory_order_relaxed);
  if (now < next || !next_report_ns_.compare_exchange_strong(next, now + kReportIntervalNs)) return;
  auto& impl = context_.impl();
  const std::scoped_lock lock(impl.mutex);
  if (impl.progress_sink) impl.progress_sink({name_, done, total_, double(now - start_ns_) * 1e-9});
}

}  // namespace lapseam
