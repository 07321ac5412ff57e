// Stands in for libFuzzer where there is no clang: replays a corpus, then feeds mutations of it.
//
//   target [-runs=N] [-max_total_time=SECONDS] [-seed=N] [file or folder ...]
//
// The mutations follow from the seed and the run's number alone, so a failure comes back. An input that
// ends the process is written to crash-input in the working folder.
#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);
// Called by the address sanitizer before it ends the process; absent without it.
extern "C" void __sanitizer_set_death_callback(void (*callback)()) __attribute__((weak));

namespace {

using Bytes = std::vector<std::uint8_t>;
Bytes current;

void SaveCurrent() {
  if (std::FILE* file = std::fopen("crash-input", "wb")) {
    std::fwrite(current.data(), 1, current.size(), file);
    std::fclose(file);
    std::fputs("input written to crash-input\n", stderr);
  }
}

void OnSignal(int signal) {
  SaveCurrent();
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

// splitmix64
struct Random {
  std::uint64_t state;
  std::uint64_t Next() {
    std::uint64_t z = (state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
  }
  std::size_t Below(std::size_t n) { return n == 0 ? 0 : static_cast<std::size_t>(Next() % n); }
};

// Pieces of text that number parsers trip over.
const char* const kTokens[] = {"nan",   "inf", "-inf", "1e309", "-0", "1e-320",
                               "0x1p3", ",",   "\n",   " ",     "-1", "99999999999"};

void MutateOnce(Random& random, const std::vector<Bytes>& corpus, Bytes& data) {
  const std::size_t at = random.Below(data.size() + 1);
  switch (random.Below(6)) {
    case 0:  // another byte
      if (!data.empty()) data[random.Below(data.size())] = static_cast<std::uint8_t>(random.Next());
      break;
    case 1:  // a flipped bit
      if (!data.empty()) data[random.Below(data.size())] ^= static_cast<std::uint8_t>(1u << random.Below(8));
      break;
    case 2: {  // a piece cut out
      const auto from = data.begin() + static_cast<std::ptrdiff_t>(at);
      const std::size_t left = static_cast<std::size_t>(data.end() - from);
      data.erase(from, from + static_cast<std::ptrdiff_t>(random.Below(std::min<std::size_t>(left, 32) + 1)));
      break;
    }
    case 3: {  // a token put in
      const char* token = kTokens[random.Below(std::size(kTokens))];
      data.insert(data.begin() + static_cast<std::ptrdiff_t>(at), token, token + std::strlen(token));
      break;
    }
    case 4:  // random bytes put in
      for (std::size_t i = 1 + random.Below(8); i > 0; --i)
        data.insert(data.begin() + static_cast<std::ptrdiff_t>(at), static_cast<std::uint8_t>(random.Next()));
      break;
    default:  // the tail of another input
      if (!corpus.empty()) {
        const Bytes& other = corpus[random.Below(corpus.size())];
        data.resize(at);
        const auto from = other.begin() + static_cast<std::ptrdiff_t>(random.Below(other.size() + 1));
        data.insert(data.end(), from, other.end());
      }
  }
}

bool Option(const char* argument, const char* name, std::uint64_t* value) {
  const std::size_t length = std::strlen(name);
  if (std::strncmp(argument, name, length) != 0) return false;
  *value = std::strtoull(argument + length, nullptr, 10);
  return true;
}

Bytes ReadAll(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return Bytes(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
}

}  // namespace

int main(int argc, char** argv) {
  std::uint64_t runs = UINT64_MAX, seconds = UINT64_MAX, seed = 1;
  std::vector<std::filesystem::path> paths;
  for (int i = 1; i < argc; ++i) {
    if (Option(argv[i], "-runs=", &runs) || Option(argv[i], "-max_total_time=", &seconds) ||
        Option(argv[i], "-seed=", &seed)) {
      continue;
    }
    if (argv[i][0] == '-' || !std::filesystem::exists(argv[i])) {
      std::fprintf(stderr, "%s: %s: neither an option nor a file\n", argv[0], argv[i]);
      return 2;
    }
    if (std::filesystem::is_directory(argv[i])) {
      for (const auto& entry : std::filesystem::directory_iterator(argv[i])) paths.push_back(entry.path());
    } else {
      paths.push_back(argv[i]);
    }
  }
  std::sort(paths.begin(), paths.end());
  std::vector<Bytes> corpus;
  for (const auto& path : paths) corpus.push_back(ReadAll(path));

  std::signal(SIGABRT, OnSignal);
  if (&__sanitizer_set_death_callback != nullptr) {
    __sanitizer_set_death_callback(SaveCurrent);
  } else {
    std::signal(SIGSEGV, OnSignal);
    std::signal(SIGFPE, OnSignal);
  }

  for (const Bytes& input : corpus) {
    current = input;
    LLVMFuzzerTestOneInput(current.data(), current.size());
  }
  if (runs == UINT64_MAX && seconds == UINT64_MAX) runs = 0;  // a plain replay
  using Clock = std::chrono::steady_clock;
  const auto start = Clock::now();
  std::uint64_t done = 0;
  for (; done < runs; ++done) {
    if (seconds != UINT64_MAX && Clock::now() - start >= std::chrono::seconds(seconds)) break;
    Random random{seed * 0x2545f4914f6cdd1du + done};
    current = corpus.empty() ? Bytes() : corpus[random.Below(corpus.size())];
    for (std::size_t i = 1 + random.Below(8); i > 0; --i) MutateOnce(random, corpus, current);
    LLVMFuzzerTestOneInput(current.data(), current.size());
  }
  std::printf("%zu inputs replayed, %llu mutations, no failure\n", corpus.size(),
              static_cast<unsigned long long>(done));
  return 0;
}
