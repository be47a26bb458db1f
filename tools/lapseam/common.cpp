#include <csignal>

#include "command.h"
#include "progress.h"

namespace lapseam::tool {
namespace {

// The context that a signal cancels. A tool process runs one command, so one is enough.
std::atomic<Context*> g_context{nullptr};
std::atomic<bool> g_interrupted{false};
static_assert(std::atomic<Context*>::is_always_lock_free && std::atomic<bool>::is_always_lock_free);

extern "C" void cancel_on_signal(int signal_number) {
  if (g_interrupted.exchange(true)) {
    // Asked twice: do not wait for a tidy end.
    std::signal(signal_number, SIG_DFL);
    std::raise(signal_number);
    return;
  }
  if (Context* context = g_context.load()) context->cancel();
}

void handle_signals() {
  struct sigaction action {};
  action.sa_handler = cancel_on_signal;
  action.sa_flags = SA_RESTART;  // a cancelled stage ends itself; its reads and writes must not fail half-way
  sigemptyset(&action.sa_mask);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

/// What the sinks share; dies with the context that owns them, and then takes the context from the signal handler.
struct Console {
  Console(const CommonOptions& options) : writer(resolve_progress_style(options.progress), stderr) {}
  ~Console() { g_context.store(nullptr); }
  ProgressWriter writer;
};

}  // namespace

void add_common_options(CLI::App& command, CommonOptions& options) {
  command.add_option("--threads", options.threads, "Worker threads; 0 is one per processor")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str()
      ->group("Common");
  command.add_option("--progress", options.progress, "auto, bar, plain, json or none, on stderr")
      ->check(CLI::IsMember({"auto", "bar", "plain", "json", "none"}))
      ->capture_default_str()
      ->group("Common");
}

std::unique_ptr<Context> make_context(const CommonOptions& options) {
  allow_threads(options.threads);
  auto context = std::make_unique<Context>(options.threads);
  auto console = std::make_shared<Console>(options);
  context->set_progress_sink([console](const Progress& event) { console->writer.on_progress(event); });
  context->set_warning_sink([console](std::string_view message) { console->writer.on_warning(message); });
  g_context.store(context.get());
  if (g_interrupted.load()) context->cancel();
  handle_signals();
  return context;
}

}  // namespace lapseam::tool
