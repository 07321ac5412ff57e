// A pool of waiting threads, so that short work does not start any.
#ifndef MRDAMP_CORE_POOL_H_
#define MRDAMP_CORE_POOL_H_

#include <algorithm>
#include <atomic>
#include <functional>
#include <memory>

namespace mrdamp {

// Every worker has its own range, whose data stay in its core's cache between calls, and takes work from the others
// when it has finished. The caller never waits for a thread that has not begun.
class Pool {
 public:
  static constexpr int kMost = 256;

  Pool();
  Pool(const Pool&) = delete;
  Pool& operator=(const Pool&) = delete;
  ~Pool();

  // task(first, last, worker) over 0 .. n - 1 in pieces of `piece`; worker: 0 .. workers - 1. One call at a time.
  template <class Task>
  void For(int n, int workers, int piece, Task&& task) {
    workers = std::min({workers, (n + piece - 1) / piece, kMost});
    if (workers > 1) workers = Gather(workers);
    if (workers <= 1) {
      if (n > 0) task(0, n, 0);
      return;
    }
    Run(n, workers, piece, std::ref(task));
  }

 private:
  struct Range {
    alignas(64) std::atomic<int> next{0};
    int end = 0;
  };
  struct Team;

  // Creates threads; returns the number of workers, the caller included.
  int Gather(int workers);
  void Run(int n, int workers, int piece, const std::function<void(int, int, int)>& task);

  std::unique_ptr<Team> team_;
};

}  // namespace mrdamp

#endif  // MRDAMP_CORE_POOL_H_
