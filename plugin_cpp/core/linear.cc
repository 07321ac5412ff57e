#include "core/linear.h"

namespace mrdamp {

Linear::Linear(const LinearSystem& s, double h)
    : n_(s.n), loads_(s.loads), elements_(s.elements), h_(h), stroke_(s.stroke), rate_(s.rate), push_(s.push), load_(s.load) {
  const int inputs = loads_ + elements_, size = 2 * n_ + 2 * inputs;
  Matrix x(size, size);
  for (int i = 0; i < n_; i++) {
    x(i, n_ + i) = h;
    for (int j = 0; j < 2 * n_; j++) x(n_ + i, j) = s.rate(i, j) * h;
    for (int k = 0; k < loads_; k++) x(n_ + i, 2 * n_ + k) = s.load(i, k) * h;
    for (int k = 0; k < elements_; k++) x(n_ + i, 2 * n_ + loads_ + k) = s.push(i, k) * h;
  }
  for (int k = 0; k < inputs; k++) x(2 * n_ + k, 2 * n_ + inputs + k) = 1;
  const Matrix e = Exponential(x);
  Matrix free(2 * n_, 2 * n_), hold(2 * n_, loads_), ramp(2 * n_, loads_);
  hold_.resize(static_cast<std::size_t>(elements_) * 2 * n_);
  ramp_.resize(hold_.size());
  for (int i = 0; i < 2 * n_; i++) {
    for (int j = 0; j < 2 * n_; j++) free(i, j) = e(i, j);
    for (int k = 0; k < inputs; k++) {
      const double to = e(i, 2 * n_ + inputs + k), from = e(i, 2 * n_ + k) - to;
      if (k < loads_) {
        hold(i, k) = from;
        ramp(i, k) = to;
      } else {
        hold_[static_cast<std::size_t>(k - loads_) * 2 * n_ + i] = from;
        ramp_[static_cast<std::size_t>(k - loads_) * 2 * n_ + i] = to;
      }
    }
  }
  free_ = Sparse(free);
  hold_load_ = Sparse(hold);
  ramp_load_ = Sparse(ramp);
  for (int of = 0; of < elements_; of++) {
    for (int by = 0; by < elements_; by++) {
      const double* held = &hold_[static_cast<std::size_t>(by) * 2 * n_];
      const double* ramped = &ramp_[static_cast<std::size_t>(by) * 2 * n_];
      give_.push_back({Along(of, held, 0), Along(of, held, n_), Along(of, ramped, 0), Along(of, ramped, n_)});
    }
  }
}

}  // namespace mrdamp
