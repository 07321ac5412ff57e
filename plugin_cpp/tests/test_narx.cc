// The network's text, its forward pass against sums by hand, and its own clock within the chain.
#include <memory>
#include <sstream>

#include "laws/narx.h"
#include "tests/record_run.h"

using mrdamp::NarxNet;
using mrdamp::ParseNarx;

namespace {

const char kTwoLayers[] =
    "mrdamp-narx 1\n"
    "sample_time 0.002\n"
    "inputs 6 x:0 v:0 v:3 i:0 F:1 F:2\n"
    "offset 0 0.1 0 0.5 0 -20\n"
    "scale 50 5 4 2 0.001 0.002\n"
    "force 10 900\n"
    "hidden 2 3 2\n"
    "weight 0.1 0.9 0.2 0.3 0.05 -0.1   -0.2 0.4 0.1 0.5 0.3 0.2   0.3 -0.7 0.6 0.1 -0.4 0.15\n"
    "bias 0.01 -0.02 0.03\n"
    "weight 0.5 -0.4 0.3   0.2 0.1 -0.6\n"
    "bias 0.1 0\n"
    "weight 0.8 -0.3\n"
    "bias 0.05\n"
    "end\n";

std::unique_ptr<NarxNet> Net(const std::string& text) {
  std::string error;
  auto net = ParseNarx(text, &error);
  check::That(net != nullptr, __FILE__, __LINE__, error);
  return net;
}

TEST(ForwardIsTheSum) {
  const auto net = Net(kTwoLayers);
  CHECK(net->inputs.size() == 6 && net->layers.size() == 3 && net->sample_time == 0.002);
  const double in[] = {0.004, -0.2, 0.15, 0.8, 350, -120};
  const double offset[] = {0, 0.1, 0, 0.5, 0, -20}, scale[] = {50, 5, 4, 2, 0.001, 0.002};
  const double w1[3][6] = {{0.1, 0.9, 0.2, 0.3, 0.05, -0.1}, {-0.2, 0.4, 0.1, 0.5, 0.3, 0.2}, {0.3, -0.7, 0.6, 0.1, -0.4, 0.15}};
  const double b1[] = {0.01, -0.02, 0.03}, w2[2][3] = {{0.5, -0.4, 0.3}, {0.2, 0.1, -0.6}}, b2[] = {0.1, 0}, w3[] = {0.8, -0.3};
  double h1[3], h2[2], y = 0.05;
  for (int r = 0; r < 3; r++) {
    h1[r] = b1[r];
    for (int c = 0; c < 6; c++) h1[r] += w1[r][c] * (in[c] - offset[c]) * scale[c];
    h1[r] = std::tanh(h1[r]);
  }
  for (int r = 0; r < 2; r++) {
    h2[r] = b2[r];
    for (int c = 0; c < 3; c++) h2[r] += w2[r][c] * h1[c];
    y += w3[r] * std::tanh(h2[r]);
  }
  NEAR(net->Forward(in), 10 + 900 * y, 1e-10);
}

// Written out with all digits and read again: the same network.
TEST(RoundTrip) {
  const auto net = Net(kTwoLayers);
  std::ostringstream text;
  text.precision(17);
  const auto row = [&](const char* word, const std::vector<double>& values) {
    text << word;
    for (const double v : values) text << ' ' << v;
    text << '\n';
  };
  text << "mrdamp-narx 1\nsample_time " << net->sample_time << "\ninputs " << net->inputs.size();
  for (const NarxNet::Input& input : net->inputs) text << ' ' << "xviF"[input.channel] << ':' << input.lag;
  text << '\n';
  row("offset", net->offset);
  row("scale", net->scale);
  text << "force " << net->force_offset << ' ' << net->force_scale << "\nhidden " << net->layers.size() - 1;
  for (std::size_t l = 0; l + 1 < net->layers.size(); l++) text << ' ' << net->layers[l].rows;
  text << '\n';
  for (const NarxNet::Layer& layer : net->layers) row("weight", layer.weight), row("bias", layer.bias);
  text << "end\n";
  const auto again = Net(text.str());
  for (double s = -1; s <= 1; s += 0.25) {
    const double in[] = {0.01 * s, 0.3 * s, 0.2, s + 1, 500 * s, -300 * s};
    CHECK(net->Forward(in) == again->Forward(in));
  }
}

std::string Broken(const std::string& from, const std::string& to) {
  std::string text = kTwoLayers;
  const std::size_t at = text.find(from);
  CHECK(at != std::string::npos);
  text.replace(at, from.size(), to);
  std::string error;
  CHECK(ParseNarx(text, &error) == nullptr);
  CHECK(!error.empty() && error.find('\n') == std::string::npos && error.size() < 200);
  return error;
}

TEST(Errors) {
  HAS(Broken("mrdamp-narx 1", "mrdamp-nark 1"), "has `mrdamp-nark` where `mrdamp-narx` is expected");
  HAS(Broken("mrdamp-narx 1", "mrdamp-narx 3"), "`mrdamp-narx`: 3 is outside [1, 1]");
  HAS(Broken("0.002\n", "0\n"), "`sample_time`: 0 is outside [1e-06, 1]");
  HAS(Broken("0.002\n", "nan\n"), "`sample_time`: `nan` is not a finite number");
  HAS(Broken("inputs 6", "inputs 5"), "has `F:2` where `offset` is expected");
  HAS(Broken("inputs 6", "inputs 0"), "`inputs`: 0 is outside [1, 512]");
  HAS(Broken("inputs 6", "inputs 2.5"), "`inputs` is not a whole number");
  HAS(Broken("F:1", "F:0"), "`inputs`: `F:0` is none of");
  HAS(Broken("F:1", "F:33"), "`F:33`");
  HAS(Broken("F:1", "F:-1"), "`F:-1`");
  HAS(Broken("F:1", "F:"), "`F:`");
  HAS(Broken("F:1", "F:1x"), "`F:1x`");
  HAS(Broken("F:1", "f:1"), "`f:1`");
  HAS(Broken("F:1", "1"), "`1`");
  HAS(Broken("F:1", "x:99999999999999999999"), "is none of");
  HAS(Broken("hidden 2 3 2", "hidden 3 3 2 2"), "`hidden`: 3 is outside [0, 2]");
  HAS(Broken("hidden 2 3 2", "hidden 2 3 257"), "`hidden`: 257 is outside [1, 256]");
  HAS(Broken("hidden 2 3 2", "hidden -1"), "outside [0, 2]");
  HAS(Broken("bias 0.1 0\n", "bias 0.1\n"), "`bias`: `weight` is not a finite number");
  HAS(Broken("bias 0.1 0\n", "bias 0.1 0 0\n"), "has `0` where `weight` is expected");
  HAS(Broken("0.8 -0.3", "0.8 1e400"), "`1e400` is not a finite number");
  HAS(Broken("0.8 -0.3", "0.8 -0,3"), "`-0,3` is not a finite number");
  HAS(Broken("end\n", ""), "ends where `end` is expected");
  HAS(Broken("end\n", "end now\n"), "goes on behind `end` with `now`");
  HAS(Broken("bias 0.05\nend\n", "bias "), "ends inside `bias`");
  std::string error;
  CHECK(ParseNarx("", &error) == nullptr);
  HAS(error, "ends where `mrdamp-narx` is expected");
  CHECK(ParseNarx(std::string(1 << 16, 'x'), &error) == nullptr);
  CHECK(error.size() < 200);
}

// What fits the format gives a finite force for inputs of any sensible size.
TEST(HugeWeightsStayFinite) {
  for (const char* number : {"1e300", "-1e300", "1e150", "1e60", "1e30"}) {
    std::ostringstream text;
    const auto n = number;
    text << "mrdamp-narx 1 sample_time 0.001 inputs 2 v:0 F:1 offset " << n << ' ' << n << " scale " << n << ' ' << n << " force " << n
         << ' ' << n << " hidden 1 2 weight " << n << " -1e10 0 " << n << " bias " << n << " -1 weight " << n << " 0 bias " << n << " end";
    std::string error;
    const auto net = ParseNarx(text.str(), &error);
    if (!net) continue;  // refused: as good
    const double in[] = {0.3, -500};
    check::That(std::isfinite(net->Forward(in)), __FILE__, __LINE__, number);
  }
}

// ---- in the chain --------------------------------------------------------------------------------------

struct Handle {
  mrdamp_narx* net;
  explicit Handle(const char* text) {
    char err[300] = "";
    net = mrdamp_narx_parse(text, err, sizeof err);
    check::That(net != nullptr, __FILE__, __LINE__, err);
  }
  ~Handle() { mrdamp_narx_free(net); }
};

double V(double t) { return 0.2 * std::cos(20 * t); }
double X(double t) { return 0.01 * std::sin(20 * t); }
double U(double t) { return 1 + 0.5 * std::sin(9 * t); }

// Over a record on the network's own grid the chain is the recursion of the paper, with the lags filled at rest.
TEST(OnItsOwnGridItIsTheRecursion) {
  const Handle h(kTwoLayers);
  const double dt = 0.002;
  const int n = 300;
  const auto got = check::Run("narx", {}, check::Sample(dt, n, X, V, U), MRDAMP_TRUE, false, h.net);
  std::vector<double> wanted;
  for (int k = 0; k < n; k++) {
    const auto past = [&](int lag) { return k >= lag ? wanted[k - lag] : 0.0; };
    const double in[] = {X(k * dt), V(k * dt), k >= 3 ? V((k - 3) * dt) : 0, U(k * dt), past(1), past(2)};
    wanted.push_back(mrdamp_narx_forward(h.net, in));
  }
  // The chain shifts the velocity within a step so that its path is that of x: some 1e-4 of it here.
  std::printf("     %.1e\n", check::Difference(got, wanted));
  CHECK(check::Difference(got, wanted) < 5e-4);
}

// Stepped finer than its grid, it passes through the same values there.
TEST(AFinerStepKeepsTheGrid) {
  const Handle h(kTwoLayers);
  const auto coarse = check::Run("narx", {}, check::Sample(0.002, 300, X, V, U), MRDAMP_TRUE, false, h.net);
  for (const int parts : {2, 5, 8}) {
    const auto fine = check::Run("narx", {}, check::Sample(0.002 / parts, 300 * parts, X, V, U), MRDAMP_TRUE, false, h.net);
    std::vector<double> on_grid;
    for (int k = 0; k < 300; k++) on_grid.push_back(fine[k * parts]);
    CHECK(check::Difference(on_grid, coarse) < 1e-3);
  }
}

// Between the grid's samples a lag is read between them.
TEST(LagsAreInterpolated) {
  const Handle h("mrdamp-narx 1 sample_time 0.002 inputs 1 v:1 offset 0 scale 1 force 0 1 hidden 0 weight 1 bias 0 end");
  const double dt = 0.0005;
  const auto got = check::Run("narx", {}, check::Sample(dt, 400, X, V, U), MRDAMP_TRUE, false, h.net);
  for (int k = 8; k < 400; k++) NEAR(got[k], V(k * dt - 0.002), 2e-4);
}

TEST(LagsReachBackAsFarAsTheySay) {
  const Handle h(
      "mrdamp-narx 1 sample_time 0.001 inputs 2 v:32 i:1 offset 0 0 scale 1 1 force 0 1 hidden 0 weight 1 10 bias 0 end");
  const double dt = 0.001;
  const auto got = check::Run("narx", {}, check::Sample(dt, 200, X, V, U), MRDAMP_TRUE, false, h.net);
  for (int k = 0; k < 200; k++) NEAR(got[k], (k >= 32 ? V((k - 32) * dt) : 0) + 10 * U(k >= 1 ? (k - 1) * dt : 0), 2e-5);
}

TEST(HeatLowersItsForce) {
  const Handle h("mrdamp-narx 1 sample_time 0.001 inputs 1 v:0 offset 0 scale 1 force 0 1 hidden 0 weight 300 bias 0 end");
  const auto got = check::Run("narx", {{"heating_kappa_yield", 0.01}, {"heating_start", 30}, {"heating_capacity", 1e12}},
                              check::Sample(0.001, 50, X, V, U), MRDAMP_TRUE, false, h.net);
  for (int k = 0; k < 50; k++) NEAR(got[k], 300 * std::exp(-0.3) * V(k * 0.001), 1e-6);
}

}  // namespace
