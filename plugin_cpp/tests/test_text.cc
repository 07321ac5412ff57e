// Numbers and dampers from text: what is taken, and the one line that refuses the rest.
#include <clocale>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>

#include "core/config.h"
#include "tests/check.h"

using mrdamp::Damper;
using mrdamp::NarxNet;
using mrdamp::ParseNumber;

namespace {

using Texts = std::map<std::string, std::string>;

const char kNet[] = "mrdamp-narx 1\nsample_time 0.001\ninputs 1 v:0\noffset 0\nscale 1\nforce 0 100\nhidden 0\nweight 2\nbias 0\nend\n";

struct Parsed {
  bool ok;
  Damper damper;
  std::unique_ptr<NarxNet> net;
  std::string error;
};

Parsed Parse(const Texts& config, const Texts& texts = {}) {
  Parsed p{};
  const auto in = [](const Texts& t) {
    return [&t](const char* name) -> const char* {
      const auto found = t.find(name);
      return found == t.end() ? nullptr : found->second.c_str();
    };
  };
  p.ok = mrdamp::ParseDamper(in(config), in(texts), &p.damper, &p.net, &p.error);
  CHECK(p.ok == p.error.empty());
  CHECK(p.error.find('\n') == std::string::npos && p.error.size() < 400);
  return p;
}

Texts Bingham() { return {{"law", "bingham"}, {"c0a", "650"}, {"c0b", "2e2"}, {"fya", "50"}, {"fyb", "400"}, {"v_ref", ".002"}}; }

Texts With(Texts t, const char* name, const char* value) {
  t[name] = value;
  return t;
}

std::string Refusal(const Texts& config, const Texts& texts = {}) {
  const Parsed p = Parse(config, texts);
  CHECK(!p.ok);
  return p.error;
}

TEST(NumbersThatAreTaken) {
  const struct {
    const char* text;
    double value;
  } rows[] = {{"1", 1}, {"-2.5e-3", -2.5e-3}, {"+7", 7}, {" 4 ", 4}, {".5", 0.5}, {"5.", 5}, {"1E3\n", 1000}, {"-0", 0}, {"1e-300", 1e-300}};
  for (const auto& row : rows) {
    double value = -99;
    std::string error;
    check::That(ParseNumber(row.text, &value, &error) && value == row.value, __FILE__, __LINE__, row.text);
  }
}

TEST(NumbersThatAreRefused) {
  for (const char* text : {"", " ", "abc", "1,5", "4.0.0", "1 2", "1e", "--1", "1e400", "-1e999", " \n", "nan", "NaN", "nan(1)", "inf",
                           "-Infinity", "1;", "0.1m", "\t", "1e3 x"}) {
    double value;
    std::string error;
    check::That(!ParseNumber(text, &value, &error) && !error.empty(), __FILE__, __LINE__, text);
    HAS(error, std::string("'") + std::string(text).substr(0, 60) + "'");
  }
}

// A program that takes over the user's locale may write a decimal comma; the model still has points.
TEST(TheLocaleDoesNotMatter) {
  for (const char* name : {"de_DE.UTF-8", "de_DE.utf8", "fr_FR.UTF-8", "ru_RU.UTF-8"}) {
    if (!std::setlocale(LC_ALL, name)) continue;
    std::printf("     %s\n", name);
    double value = 0;
    std::string error;
    CHECK(ParseNumber("0.5", &value, &error) && value == 0.5);
    CHECK(!ParseNumber("0,5", &value, &error));
    std::unique_ptr<NarxNet> net = mrdamp::ParseNarx(kNet, &error);
    CHECK(net && net->sample_time == 0.001);
  }
  std::setlocale(LC_ALL, "C");
}

TEST(ALongTextIsCutInTheMessage) {
  double value;
  std::string error;
  CHECK(!ParseNumber(std::string(10000, 'x').c_str(), &value, &error));
  CHECK(error.size() < 120);
}

TEST(EveryLawTakesItsParameters) {
  for (int law = 0; law < mrdamp::kLawCount; law++) {
    Texts t = {{"law", mrdamp::kLawNames[law]}};
    for (int i = 0; i < mrdamp::kParamCount; i++) {
      if (mrdamp::LawUses(static_cast<mrdamp::Law>(law), i) != 0) t[mrdamp::kAttributes[i].name] = "1.25";
    }
    if (static_cast<mrdamp::Law>(law) == mrdamp::Law::kNarx) t["weights"] = "text:net";
    if (t.count("hysteresis_floor")) t["hysteresis_floor"] = "0.5";
    const Parsed p = Parse(t, {{"net", kNet}});
    check::That(p.ok, __FILE__, __LINE__, p.error);
    CHECK(static_cast<int>(p.damper.law) == law);
    if (t.count("A")) CHECK(p.damper.p.A == 1.25 && p.damper.p.hysteresis_floor == 0.5);
  }
}

TEST(ValuesLandWhereTheyBelong) {
  const Parsed p = Parse(With(With(Bingham(), "driver_lag_tau", "0.008"), "command_max", "2"));
  CHECK(p.ok);
  CHECK(p.damper.p.c0a == 650 && p.damper.p.c0b == 200 && p.damper.p.fya == 50 && p.damper.p.fyb == 400);
  CHECK(p.damper.p.v_ref == 0.002 && p.damper.p.driver_lag_tau == 0.008 && p.damper.p.command_max == 2);
  CHECK(std::isnan(p.damper.p.command_min));
  CHECK(p.damper.p.sensor_gain_g == 1 && p.damper.p.backlash_k == 2e6);  // neutral where not given
  CHECK(p.damper.Clamp(9) == 2 && p.damper.Clamp(-9) == -2);
}

TEST(AnEmptyAttributeIsNotGiven) {
  CHECK(Parse(With(Bingham(), "heating_loss", "")).ok);
  HAS(Refusal(With(Bingham(), "c0a", "")), "needs attribute 'c0a' (N s/m)");
}

TEST(BadLaws) {
  HAS(Refusal({}), "'law' is missing; allowed: bingham, bouc_wen, ");
  HAS(Refusal({{"law", ""}}), "missing");
  HAS(Refusal({{"law", "dahl"}}), "'dahl'; allowed: bingham");
  HAS(Refusal({{"law", "Bingham"}}), "'Bingham'");
}

TEST(BadParameters) {
  Texts t = Bingham();
  t.erase("fyb");
  HAS(Refusal(t), "law bingham needs attribute 'fyb' (N per command)");
  t.erase("c0a");
  HAS(Refusal(t), "law bingham needs attribute 'c0a' (N s/m), 'fyb' (N per command)");
  HAS(Refusal(With(Bingham(), "alpha_a", "3")), "'alpha_a' = '3' is no parameter of law bingham; it takes c0a c0b fya fyb v_ref");
  HAS(Refusal(With(Bingham(), "k1e", "3")), "'k1e'");
  HAS(Refusal(With(Bingham(), "c0a", "6,5")), "attribute 'c0a' = '6,5' is not a number; allowed: a number (N s/m)");
  HAS(Refusal(With(Bingham(), "c0a", "nan")), "not a finite number");
  HAS(Refusal(With(Bingham(), "v_ref", "-0.1")), "v_ref = -0.1 is outside [0, inf] m/s");
  HAS(Refusal(With(Bingham(), "sensor_gain_g", "101")), "sensor_gain_g = 101 is outside [-100, 100]");
  HAS(Refusal(With(Bingham(), "substep", "0")), "substep = 0 is outside [1e-06, 1] s");
  HAS(Refusal(With(With(Bingham(), "command_min", "3"), "command_max", "2")), "command_min = 3 is above command_max = 2");
}

TEST(ParametersThatOnlyTogetherAreBad) {
  Texts bouc_wen = {{"law", "bouc_wen"}, {"c0a", "1"}, {"c0b", "0"}, {"alpha_a", "9"}, {"alpha_b", "0"}, {"gamma", "2e5"},
                    {"beta", "-3e5"}, {"A", "100"}, {"n", "2"}, {"k0", "0"}, {"x0", "0"}};
  HAS(Refusal(bouc_wen), "beta + gamma = -100000; it must be above 0");
  CHECK(Parse(With(bouc_wen, "beta", "-1e5")).ok);
  HAS(Refusal(With(bouc_wen, "n", "0.5")), "n = 0.5 is outside [1, 20]");
  Texts spencer = With(With(With(With(bouc_wen, "law", "modified_bouc_wen"), "beta", "2e5"), "c1a", "0"), "c1b", "1");
  spencer["k1"] = "0";
  HAS(Refusal(spencer), "c1a = 0; it must be above 0");
}

TEST(Weights) {
  const Texts narx = {{"law", "narx"}};
  HAS(Refusal(narx), "law narx needs `weights`");
  HAS(Refusal(With(narx, "weights", "text:nothing")), "'text:nothing': the model has no <custom><text>");
  HAS(Refusal(With(narx, "weights", "no/such/file.txt")), "'no/such/file.txt': no such file");
  HAS(Refusal(With(narx, "weights", "text:net"), {{"net", "mrdamp-narx 2"}}), "attribute 'weights' = 'text:net': NARX weights: ");
  HAS(Refusal(With(Bingham(), "weights", "text:net"), {{"net", kNet}}), "'weights' = 'text:net' is for law narx alone");
  HAS(Refusal(With(With(narx, "weights", "text:net"), "shear_thinning_m", "0.5"), {{"net", kNet}}), "shear_thinning_m");
  HAS(Refusal(With(With(narx, "weights", "text:net"), "heating_kappa", "0.5"), {{"net", kNet}}), "heating_kappa");
  HAS(Refusal(With(With(narx, "weights", "text:net"), "c0a", "5"), {{"net", kNet}}), "'c0a' = '5' is no parameter of law narx; it takes none");
  const Parsed p = Parse(With(narx, "weights", "text:net"), {{"net", kNet}});
  CHECK(p.ok && p.damper.net == p.net.get() && p.net->sample_time == 0.001);
}

TEST(WeightsFromAFileAndFromTheSearchPath) {
  char folder[] = "/tmp/mrdamp-test-XXXXXX";
  CHECK(mkdtemp(folder) != nullptr);
  const std::string path = std::string(folder) + "/net.txt";
  std::FILE* file = std::fopen(path.c_str(), "w");
  std::fputs(kNet, file);
  std::fclose(file);
  CHECK(Parse({{"law", "narx"}, {"weights", path}}).ok);
  unsetenv("MRDAMP_PATH");
  CHECK(!Parse({{"law", "narx"}, {"weights", "net.txt"}}).ok);
  setenv("MRDAMP_PATH", (std::string("/nowhere::") + folder).c_str(), 1);
  CHECK(Parse({{"law", "narx"}, {"weights", "net.txt"}}).ok);
  HAS(Refusal({{"law", "narx"}, {"weights", "other.txt"}}), "MRDAMP_PATH");
  unsetenv("MRDAMP_PATH");
  std::remove(path.c_str());
  std::remove(folder);
}

// The next parse must not see anything of the one before.
TEST(ParsingAgainStartsFromNeutral) {
  Parsed p = Parse(With(Bingham(), "driver_lag_tau", "0.008"));
  const Texts plain = Bingham();
  const auto config = [&](const char* name) -> const char* {
    const auto found = plain.find(name);
    return found == plain.end() ? nullptr : found->second.c_str();
  };
  CHECK(mrdamp::ParseDamper(config, config, &p.damper, &p.net, &p.error));
  CHECK(p.damper.p.driver_lag_tau == 0);
}

TEST(TheTableIsSound) {
  for (int i = 0; i < mrdamp::kParamCount; i++) {
    const mrdamp::Attribute& a = mrdamp::kAttributes[i];
    CHECK(a.min < a.max);
    CHECK(std::isnan(a.def) || (a.def >= a.min && a.def <= a.max));
    CHECK(mrdamp::FindAttribute(a.name) == i);
    CHECK(a.unit[0] && a.meaning[0] && a.group[0]);
    const bool of_law = !std::strcmp(a.group, "law") || !std::strcmp(a.group, "dependence");
    int users = 0;
    for (int law = 0; law < mrdamp::kLawCount; law++) users += mrdamp::LawUses(static_cast<mrdamp::Law>(law), i) != 0;
    CHECK(of_law == (users > 0));
  }
  CHECK(mrdamp::FindAttribute("c0") == -1 && mrdamp::FindAttribute("") == -1 && mrdamp::FindLaw("") == -1);
}

}  // namespace
