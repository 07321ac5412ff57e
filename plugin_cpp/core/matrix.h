// A dense matrix with the operations of the frame.
#ifndef MRDAMP_CORE_MATRIX_H_
#define MRDAMP_CORE_MATRIX_H_

#include <cmath>
#include <vector>

namespace mrdamp {

struct Matrix {
  int n, m;
  std::vector<double> a;  // row-major
  Matrix(int rows, int cols) : n(rows), m(cols), a(static_cast<std::size_t>(rows) * cols, 0.0) {}
  double& operator()(int i, int j) { return a[static_cast<std::size_t>(i) * m + j]; }
  double operator()(int i, int j) const { return a[static_cast<std::size_t>(i) * m + j]; }
};

inline Matrix operator*(const Matrix& x, const Matrix& y) {
  Matrix z(x.n, y.m);
  for (int i = 0; i < x.n; i++) {
    for (int k = 0; k < x.m; k++) {
      const double f = x(i, k);
      if (f == 0) continue;
      for (int j = 0; j < y.m; j++) z(i, j) += f * y(k, j);
    }
  }
  return z;
}

// exp(x) of a square matrix: scaling and squaring over a Taylor series of 16 terms.
inline Matrix Exponential(Matrix x) {
  double norm = 0;
  for (int i = 0; i < x.n; i++) {
    double row = 0;
    for (int j = 0; j < x.n; j++) row += std::fabs(x(i, j));
    norm = std::fmax(norm, row);
  }
  const int squarings = norm > 0.25 ? static_cast<int>(std::ceil(std::log2(norm / 0.25))) : 0;
  const double scale = std::ldexp(1.0, -squarings);
  for (double& v : x.a) v *= scale;
  Matrix sum(x.n, x.n), term(x.n, x.n);
  for (int i = 0; i < x.n; i++) sum(i, i) = term(i, i) = 1;
  for (int k = 1; k <= 16; k++) {
    term = term * x;
    for (double& v : term.a) v /= k;
    for (std::size_t i = 0; i < sum.a.size(); i++) sum.a[i] += term.a[i];
  }
  for (int k = 0; k < squarings; k++) sum = sum * sum;
  return sum;
}

}  // namespace mrdamp

#endif  // MRDAMP_CORE_MATRIX_H_
