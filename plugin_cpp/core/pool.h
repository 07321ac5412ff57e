// Threads that wait for work, so that short work need not start any.
#ifndef MRDAMP_CORE_POOL_H_
#define MRDAMP_CORE_POOL_H_

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace mrdamp {

class Pool {
 public:
  static constexpr int kMost = 256;

  Pool() = default;
  Pool(const Pool&) = delete;
  Pool& operator=(const Pool&) = delete;
  ~Pool() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      stopped_ = true;
    }
    wake_.notify_all();
    for (std::thread& t : threads_) t.join();
  }

  // task(first, last, worker) over 0 .. n - 1 in pieces of `piece`; worker: 0 .. workers - 1. One call at a time.
  template <class Task>
  void For(int n, int workers, int piece, Task&& task) {
    workers = std::min({workers, (n + piece - 1) / piece, kMost});
    if (workers <= 1) {
      task(0, n, 0);
      return;
    }
    while (static_cast<int>(threads_.size()) < workers - 1) {
      const int own = static_cast<int>(threads_.size()) + 1;
      threads_.emplace_back([this, own] { Wait(own); });
    }
    next_.store(0);
    const std::function<void(int)> work = [&](int worker) {
      for (int i; (i = next_.fetch_add(piece)) < n;) task(i, std::min(i + piece, n), worker);
    };
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      work_ = &work;
      wanted_ = workers - 1;
      busy_ = workers - 1;
      round_.fetch_add(1);
    }
    wake_.notify_all();
    work(0);
    for (int spin = 0; spin < kSpins && busy_.load() > 0; spin++) Relax();
    std::unique_lock<std::mutex> lock(mutex_);
    done_.wait(lock, [this] { return busy_.load() == 0; });
  }

 private:
  // About 20 us: calls that follow each other at once find the threads awake.
  static constexpr int kSpins = 1000;

  static void Relax() {
#if defined(__x86_64__) || defined(__i386__)
    __builtin_ia32_pause();
#endif
  }

  void Wait(int own) {
    for (unsigned seen = 0;;) {
      for (int spin = 0; spin < kSpins && round_.load() == seen; spin++) Relax();
      const std::function<void(int)>* work = nullptr;
      {
        std::unique_lock<std::mutex> lock(mutex_);
        wake_.wait(lock, [&] { return stopped_ || round_.load() != seen; });
        if (stopped_) return;
        seen = round_.load();
        if (own <= wanted_) work = work_;
      }
      if (!work) continue;
      (*work)(own);
      if (busy_.fetch_sub(1) == 1) {
        const std::lock_guard<std::mutex> lock(mutex_);
        done_.notify_one();
      }
    }
  }

  std::vector<std::thread> threads_;
  std::mutex mutex_;
  std::condition_variable wake_, done_;
  std::atomic<unsigned> round_{0};
  std::atomic<int> next_{0}, busy_{0};
  int wanted_ = 0;
  const std::function<void(int)>* work_ = nullptr;
  bool stopped_ = false;
};

}  // namespace mrdamp

#endif  // MRDAMP_CORE_POOL_H_
