// A linear structure with scalar elements, stepped exactly for inputs that are constant or linear over the step: one of
// them (T double), or a pack of copies in different states.
#ifndef MRDAMP_CORE_LINEAR_H_
#define MRDAMP_CORE_LINEAR_H_

#include <vector>

#include "core/matrix.h"

namespace mrdamp {

// n coordinates q; rates of their velocities per unit of every input.
struct LinearSystem {
  int n, loads, elements;
  Matrix rate;    // n x 2 n: of the coordinates, then of their velocities
  Matrix load;    // n x loads
  Matrix stroke;  // elements x n: elongation of each element per unit of the coordinates
  Matrix push;    // n x elements: per N of an element's tension

  LinearSystem(int coordinates, int load_count, int element_count)
      : n(coordinates), loads(load_count), elements(element_count), rate(n, 2 * n), load(n, loads),
        stroke(elements, n), push(n, elements) {}
};

// A matrix without its zeros, row by row.
class Sparse {
 public:
  Sparse() = default;
  explicit Sparse(const Matrix& m) {
    for (int i = 0; i < m.n; i++) {
      for (int j = 0; j < m.m; j++) {
        if (m(i, j) == 0) continue;
        column_.push_back(j);
        value_.push_back(m(i, j));
      }
      end_.push_back(static_cast<int>(column_.size()));
    }
  }

  template <class T>
  T Row(int i, const T* x) const {
    T sum = 0;
    for (int k = i > 0 ? end_[i - 1] : 0; k < end_[i]; k++) sum += value_[k] * x[column_[k]];
    return sum;
  }
  // y += this x
  template <class T>
  void Add(const T* x, T* y) const {
    for (int i = 0, k = 0; i < static_cast<int>(end_.size()); i++) {
      T sum = y[i];
      for (; k < end_[i]; k++) sum += value_[k] * x[column_[k]];
      y[i] = sum;
    }
  }

 private:
  std::vector<int> column_, end_;
  std::vector<double> value_;
};

// The structure over a step of h: x1 = free x0 + hold i0 + ramp i1 for inputs i that run linearly from i0 to i1: the
// loads and the elements' forces.
class Linear {
 public:
  Linear(const LinearSystem& system, double h);

  // End of the step without the elements; q and end: 2 n.
  template <class T>
  void Free(const T* q, const T* load0, const T* load1, T* end) const {
    for (int i = 0; i < 2 * n_; i++) end[i] = 0;
    free_.Add(q, end);
    hold_load_.Add(load0, end);
    ramp_load_.Add(load1, end);
  }
  // Adds an element's force that runs from `start` to `end`.
  template <class T>
  void Push(int element, T start, T end, T* q) const {
    const double* hold = &hold_[static_cast<std::size_t>(element) * 2 * n_];
    const double* ramp = &ramp_[static_cast<std::size_t>(element) * 2 * n_];
    for (int i = 0; i < 2 * n_; i++) q[i] += hold[i] * start + ramp[i] * end;
  }
  // Elongation of an element (offset 0) or its rate (offset n).
  template <class T>
  T Along(int element, const T* q, int offset) const {
    return stroke_.Row(element, q + offset);
  }

  // Change of an element's end over a step, in x and v, per unit of another element's force, constant or increasing
  // linearly.
  struct Compliance {
    double hold_x, hold_v, ramp_x, ramp_v;
  };
  const Compliance& ComplianceOf(int of, int by) const { return give_[static_cast<std::size_t>(of) * elements_ + by]; }

  // Rates of the present velocities, (n): from the motion, the elements' forces and, if `load` is given, the loads.
  template <class T>
  void Rates(const T* q, const T* forces, const T* load, T* rate) const {
    for (int i = 0; i < n_; i++) rate[i] = 0;
    rate_.Add(q, rate);
    push_.Add(forces, rate);
    if (load) load_.Add(load, rate);
  }

  int n() const { return n_; }
  int loads() const { return loads_; }
  int elements() const { return elements_; }
  double h() const { return h_; }

 private:
  int n_, loads_, elements_;
  double h_;
  Sparse free_, hold_load_, ramp_load_, stroke_, rate_, push_, load_;
  std::vector<double> hold_, ramp_;  // elements x 2 n
  std::vector<Compliance> give_;           // elements x elements
};

}  // namespace mrdamp

#endif  // MRDAMP_CORE_LINEAR_H_
