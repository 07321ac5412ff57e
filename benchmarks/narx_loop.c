/* Passes of a network whose last input is its own last output, as in a free run. Compiled by narx.py. */
double narx_loop(double (*forward)(const void*, const double*), const void* net, double* in, int last, long n) {
  double force = 0;
  for (long k = 0; k < n; k++) {
    in[0] += 1e-9;
    in[last] = force;
    force = forward(net, in);
  }
  return force;
}
