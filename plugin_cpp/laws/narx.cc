#include "laws/narx.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <sstream>

namespace mrdamp {

double NarxNet::Forward(const double* in) const {
  double a[kMaxInputs], b[kMaxUnits];
  const int n = static_cast<int>(inputs.size());
  for (int i = 0; i < n; i++) a[i] = (in[i] - offset[i]) * scale[i];
  double* from = a;
  double* to = b;
  for (std::size_t l = 0; l < layers.size(); l++) {
    const Layer& layer = layers[l];
    const bool last = l + 1 == layers.size();
    for (int r = 0; r < layer.rows; r++) {
      const double* w = layer.weight.data() + static_cast<std::size_t>(r) * layer.cols;
      // Four running sums: the order is fixed, so the result does not depend on the compiler's vectors.
      double s0 = layer.bias[r], s1 = 0, s2 = 0, s3 = 0;
      int c = 0;
      for (; c + 4 <= layer.cols; c += 4) {
        s0 += w[c] * from[c];
        s1 += w[c + 1] * from[c + 1];
        s2 += w[c + 2] * from[c + 2];
        s3 += w[c + 3] * from[c + 3];
      }
      for (; c < layer.cols; c++) s0 += w[c] * from[c];
      const double s = (s0 + s1) + (s2 + s3);
      to[r] = last ? s : std::tanh(s);
    }
    std::swap(from, to);
  }
  return from[0] * force_scale + force_offset;
}

namespace {

// Reader of the weights file: one keyword a line, numbers behind it.
class Reader {
 public:
  explicit Reader(const std::string& text) : in_(text) {}

  bool Word(const char* keyword, std::string* error) {
    std::string word;
    if (!(in_ >> word)) return Fail(error, std::string("ends where `") + keyword + "` is expected");
    if (word != keyword) return Fail(error, "has `" + word.substr(0, 40) + "` where `" + keyword + "` is expected");
    return true;
  }

  bool Number(const char* what, double lo, double hi, double* value, std::string* error) {
    std::string word;
    if (!(in_ >> word)) return Fail(error, std::string("ends inside `") + what + "`");
    const char* last = word.data() + word.size();
    const std::from_chars_result read = std::from_chars(word.data(), last, *value);
    if (read.ec != std::errc() || read.ptr != last || !std::isfinite(*value)) {
      return Fail(error, std::string("`") + what + "`: `" + word.substr(0, 40) + "` is not a finite number");
    }
    if (*value < lo || *value > hi) {
      std::ostringstream line;
      line << "`" << what << "`: " << *value << " is outside [" << lo << ", " << hi << "]";
      return Fail(error, line.str());
    }
    return true;
  }

  bool Count(const char* what, int lo, int hi, int* value, std::string* error) {
    double number;
    if (!Number(what, lo, hi, &number, error)) return false;
    if (number != std::floor(number)) return Fail(error, std::string("`") + what + "` is not a whole number");
    *value = static_cast<int>(number);
    return true;
  }

  bool Numbers(const char* what, int n, double lo, double hi, std::vector<double>* values, std::string* error) {
    values->resize(n);
    for (double& v : *values) {
      if (!Number(what, lo, hi, &v, error)) return false;
    }
    return true;
  }

  bool Input(NarxNet::Input* input, std::string* error) {
    static const char* const kNames[] = {"x", "v", "i", "F"};
    std::string word;
    if (!(in_ >> word)) return Fail(error, "ends inside `inputs`");
    const std::size_t colon = word.find(':');
    for (int c = 0; c < NarxNet::kChannels; c++) {
      if (colon == std::string::npos || word.substr(0, colon) != kNames[c]) continue;
      char* end = nullptr;
      const long lag = std::strtol(word.c_str() + colon + 1, &end, 10);
      const long least = c == NarxNet::kF ? 1 : 0;
      if (end == word.c_str() + colon + 1 || *end || lag < least || lag > NarxNet::kMaxLag) break;
      *input = {static_cast<NarxNet::Channel>(c), static_cast<int>(lag)};
      return true;
    }
    return Fail(error, "`inputs`: `" + word.substr(0, 40) +
                           "` is none of x:LAG, v:LAG, i:LAG (lag 0 to 32), F:LAG (lag 1 to 32)");
  }

  bool End(std::string* error) {
    std::string word;
    if (in_ >> word) return Fail(error, "goes on behind `end` with `" + word.substr(0, 40) + "`");
    return true;
  }

  static bool Fail(std::string* error, const std::string& text) {
    if (error) *error = "NARX weights: the text " + text;
    return false;
  }

 private:
  std::istringstream in_;
};

}  // namespace

std::unique_ptr<NarxNet> ParseNarx(const std::string& text, std::string* error) {
  Reader r(text);
  auto net = std::make_unique<NarxNet>();
  const double big = 1e30;  // sums of products of three such numbers stay finite
  int version, inputs, hidden;
  if (!r.Word("mrdamp-narx", error) || !r.Count("mrdamp-narx", 1, 1, &version, error)) return nullptr;
  if (!r.Word("sample_time", error) || !r.Number("sample_time", 1e-6, 1, &net->sample_time, error)) return nullptr;
  if (!r.Word("inputs", error) || !r.Count("inputs", 1, NarxNet::kMaxInputs, &inputs, error)) return nullptr;
  net->inputs.resize(inputs);
  for (NarxNet::Input& input : net->inputs) {
    if (!r.Input(&input, error)) return nullptr;
  }
  if (!r.Word("offset", error) || !r.Numbers("offset", inputs, -big, big, &net->offset, error)) return nullptr;
  if (!r.Word("scale", error) || !r.Numbers("scale", inputs, -big, big, &net->scale, error)) return nullptr;
  if (!r.Word("force", error) || !r.Number("force", -big, big, &net->force_offset, error)) return nullptr;
  if (!r.Number("force", -big, big, &net->force_scale, error)) return nullptr;
  if (!r.Word("hidden", error) || !r.Count("hidden", 0, 2, &hidden, error)) return nullptr;
  std::vector<int> units(hidden);
  for (int& u : units) {
    if (!r.Count("hidden", 1, NarxNet::kMaxUnits, &u, error)) return nullptr;
  }
  units.push_back(1);
  int from = inputs;
  for (int u : units) {
    NarxNet::Layer layer{u, from, {}, {}};
    if (!r.Word("weight", error) || !r.Numbers("weight", u * from, -big, big, &layer.weight, error)) return nullptr;
    if (!r.Word("bias", error) || !r.Numbers("bias", u, -big, big, &layer.bias, error)) return nullptr;
    net->layers.push_back(std::move(layer));
    from = u;
  }
  if (!r.Word("end", error) || !r.End(error)) return nullptr;
  return net;
}

void Narx::Start(const NarxNet& net, NarxHistory* past, double x, double v, double i) {
  *past = NarxHistory();
  std::fill_n(past->value[NarxNet::kX], NarxHistory::kLength, x);
  std::fill_n(past->value[NarxNet::kI], NarxHistory::kLength, i);
  past->value[NarxNet::kV][0] = v;
  past->value[NarxNet::kF][0] = Force(net, *past, 0, x, v, i);
}

void Narx::Push(const NarxNet& net, NarxHistory* past, double x, double v, double i) {
  for (auto& channel : past->value) {
    std::memmove(channel + 1, channel, sizeof(double) * (NarxHistory::kLength - 1));
  }
  past->count += 1;
  Amend(net, past, x, v, i);
}

void Narx::Amend(const NarxNet& net, NarxHistory* past, double x, double v, double i) {
  past->value[NarxNet::kX][0] = x;
  past->value[NarxNet::kV][0] = v;
  past->value[NarxNet::kI][0] = i;
  past->value[NarxNet::kF][0] = Force(net, *past, 0, x, v, i);
}

double Narx::Force(const NarxNet& net, const NarxHistory& past, double part, double x, double v, double i) {
  const double now[] = {x, v, i};
  double in[NarxNet::kMaxInputs];
  for (std::size_t k = 0; k < net.inputs.size(); k++) {
    const NarxNet::Input input = net.inputs[k];
    const double* old = past.value[input.channel];
    if (input.lag == 0) in[k] = now[input.channel];
    else if (part == 0) in[k] = old[input.lag];
    else in[k] = old[input.lag] + part * (old[input.lag - 1] - old[input.lag]);
  }
  return net.Forward(in);
}

}  // namespace mrdamp
