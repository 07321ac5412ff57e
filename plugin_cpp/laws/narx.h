// NARX network (Chen, Ni, Or 2015: "Characterization and modeling of a self-sensing MR damper under harmonic
// loading", Eqs. 5, 9 and 11): F(t) = f(x(t).., v(t).., i(t).., F(t - 1)..), one or two tanh layers, linear output.
#ifndef MRDAMP_LAWS_NARX_H_
#define MRDAMP_LAWS_NARX_H_

#include <memory>
#include <string>
#include <vector>

namespace mrdamp {

struct NarxNet {
  static constexpr int kMaxLag = 32;       // samples
  static constexpr int kMaxUnits = 256;    // per layer
  static constexpr int kMaxInputs = 512;
  enum Channel { kX, kV, kI, kF, kChannels };

  struct Input {
    Channel channel;
    int lag;  // samples; at least 1 for kF
  };
  struct Layer {
    int rows, cols;
    std::vector<double> weight;  // rows x cols, row-major
    std::vector<double> bias;    // rows
  };

  double sample_time = 0;  // s
  std::vector<Input> inputs;
  std::vector<double> scale, offset;  // input in [-1, 1] = (physical - offset) * scale
  double force_scale = 1, force_offset = 0;  // force = network output * scale + offset
  std::vector<Layer> layers;                 // hidden layers, then the linear output

  // One pass: inputs in physical units -> force (N).
  double Forward(const double* in) const;
};

// Reads the text of a weights file (format: plugin_cpp/README.md). On failure an empty pointer and one line.
std::unique_ptr<NarxNet> ParseNarx(const std::string& text, std::string* error);

// Samples of the past on the network's own grid, newest first.
struct NarxHistory {
  static constexpr int kLength = NarxNet::kMaxLag + 2;
  double count = 0;                              // grid samples since the start
  double value[NarxNet::kChannels][kLength] = {};  // value[c][j]: j samples before the newest
};

struct Narx {
  // Lags filled with the state of rest: present x and i, v = 0 before the first sample, zero force.
  static void Start(const NarxNet& net, NarxHistory* past, double x, double v, double i);
  // Appends one grid sample.
  static void Push(const NarxNet& net, NarxHistory* past, double x, double v, double i);
  // Replaces the newest sample's values.
  static void Amend(const NarxNet& net, NarxHistory* past, double x, double v, double i);
  // Force at the fraction `part` of a sample time after the newest grid sample, 0 <= part < 1: the network as if the
  // present were a sample, with lags interpolated on the grid. At part = 0 it is the grid's own force.
  static double Force(const NarxNet& net, const NarxHistory& past, double part, double x, double v, double i);
};

}  // namespace mrdamp

#endif  // MRDAMP_LAWS_NARX_H_
