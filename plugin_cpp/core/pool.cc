#include "core/pool.h"

#include <pthread.h>
#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace mrdamp {

namespace {

// A thread spins for so long before it sleeps: longer than what a caller does between two calls that follow each other
// at once (observations and rewards of 64 rows: 60 us), far shorter than a time slice of the system's.
constexpr std::chrono::microseconds kSpin{150};

void Relax() {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#endif
}

// Until `reached` or the time is up; whether it was reached.
template <class Reached>
bool SpinUntil(Reached&& reached) {
  const auto end = std::chrono::steady_clock::now() + kSpin;
  for (;;) {
    for (int k = 0; k < 16; k++) {
      if (reached()) return true;
      Relax();
    }
    if (std::chrono::steady_clock::now() > end) return false;
  }
}

// A round of work as one word: its number, whether it is open, for how many workers, and how many threads are in it.
using Word = std::uint64_t;
constexpr Word kOpen = Word{1} << 31;
constexpr int kWorkersAt = 16, kNumberAt = 32;
constexpr Word kInside = (Word{1} << kWorkersAt) - 1;

Word Number(Word w) { return w >> kNumberAt; }
int Workers(Word w) { return static_cast<int>((w & (kOpen - 1)) >> kWorkersAt); }
bool IsFor(Word w, int worker, Word joined) { return (w & kOpen) && worker < Workers(w) && Number(w) != joined; }

// A condition variable of POSIX. The symbol of std::condition_variable::wait is that of GCC 12 (GLIBCXX_3.4.30), and
// a wheel with it would not load with the C++ library of GCC 11.
class Condition {
 public:
  Condition() = default;
  ~Condition() { pthread_cond_destroy(&condition_); }
  Condition(const Condition&) = delete;
  Condition& operator=(const Condition&) = delete;

  template <class Reached>
  void Wait(std::unique_lock<std::mutex>& lock, Reached&& reached) {
    while (!reached()) pthread_cond_wait(&condition_, lock.mutex()->native_handle());
  }
  void NotifyOne() { pthread_cond_signal(&condition_); }
  void NotifyAll() { pthread_cond_broadcast(&condition_); }

 private:
  pthread_cond_t condition_ = PTHREAD_COND_INITIALIZER;
};

}  // namespace

struct Pool::Team {
  alignas(64) std::atomic<Word> round{0};
  alignas(64) std::atomic<int> sleeping{0};
  std::atomic<bool> stopped{false};
  std::mutex mutex;
  Condition wake, done;
  // Of the open round; written by the caller while none is.
  const std::function<void(int, int, int)>* task = nullptr;
  int piece = 1;
  std::unique_ptr<Range[]> ranges{new Range[kMost]};
  std::vector<std::thread> threads;
  pid_t process = getpid();

  void Work(int worker, int workers) {
    for (int k = 0; k < workers; k++) {
      Range& r = ranges[(worker + k) % workers];
      for (int i; (i = r.next.fetch_add(piece)) < r.end;) (*task)(i, std::min(i + piece, r.end), worker);
    }
  }

  void Serve(int worker) {
    for (Word joined = 0;;) {
      const auto called = [&] { return stopped.load() || IsFor(round.load(), worker, joined); };
      if (!SpinUntil(called)) {
        std::unique_lock<std::mutex> lock(mutex);
        sleeping.fetch_add(1);
        wake.Wait(lock, called);
        sleeping.fetch_sub(1);
      }
      if (stopped.load()) return;
      Word w = round.load();
      while (IsFor(w, worker, joined) && !round.compare_exchange_weak(w, w + 1)) {
      }
      if (!IsFor(w, worker, joined)) continue;
      joined = Number(w);
      Work(worker, Workers(w));
      const Word before = round.fetch_sub(1);
      if (!(before & kOpen) && (before & kInside) == 1) {
        const std::lock_guard<std::mutex> lock(mutex);
        done.NotifyOne();
      }
    }
  }
};

Pool::Pool() = default;

Pool::~Pool() {
  if (!team_) return;
  // In a forked process the threads do not exist, and what they held is in no state to be destroyed.
  if (team_->process != getpid()) {
    static_cast<void>(team_.release());
    return;
  }
  {
    const std::lock_guard<std::mutex> lock(team_->mutex);
    team_->stopped.store(true);
  }
  team_->wake.NotifyAll();
  for (std::thread& t : team_->threads) t.join();
}

int Pool::Gather(int workers) {
  if (team_ && team_->process != getpid()) static_cast<void>(team_.release());
  if (!team_) team_ = std::make_unique<Team>();
  std::vector<std::thread>& threads = team_->threads;
  try {
    while (static_cast<int>(threads.size()) < workers - 1) {
      Team* team = team_.get();
      const int own = static_cast<int>(threads.size()) + 1;
      threads.emplace_back([team, own] { team->Serve(own); });
    }
  } catch (const std::system_error&) {  // no more threads to be had: those that there are do it
  }
  return std::min(workers, static_cast<int>(threads.size()) + 1);
}

void Pool::Run(int n, int workers, int piece, const std::function<void(int, int, int)>& task) {
  Team& t = *team_;
  for (int k = 0; k < workers; k++) {
    const auto at = [&](int part) { return static_cast<int>(static_cast<std::int64_t>(n) * part / workers); };
    t.ranges[k].next.store(at(k));
    t.ranges[k].end = at(k + 1);
  }
  t.task = &task;
  t.piece = piece;
  const Word number = (Number(t.round.load()) + 1) & 0xffffffff;
  t.round.store(number << kNumberAt | kOpen | static_cast<Word>(workers) << kWorkersAt);
  if (t.sleeping.load() > 0) {
    { const std::lock_guard<std::mutex> lock(t.mutex); }
    t.wake.NotifyAll();
  }
  t.Work(0, workers);
  t.round.fetch_and(~kOpen);
  const auto over = [&] { return (t.round.load() & kInside) == 0; };
  if (SpinUntil(over)) return;
  std::unique_lock<std::mutex> lock(t.mutex);
  t.done.Wait(lock, over);
}

}  // namespace mrdamp
