// SPDX-License-Identifier: Apache-2.0
// Runs a fuzz target without libFuzzer:
//
//     NAME_replay FOLDER [COUNT [SEED]]
//
// on each file of a folder, so that what a fuzzer once found worth keeping stays tested; then on
// COUNT files that are made of these by random changes.
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);

namespace {

using Bytes = std::vector<uint8_t>;
using Random = std::mt19937_64;

size_t Below(Random& random, size_t most) { return most == 0 ? 0 : random() % most; }

// A few bytes become others, go, come twice, or come from another file.
void Change(const std::vector<Bytes>& files, Random& random, Bytes* bytes) {
  const auto at = [&](size_t i) { return bytes->begin() + static_cast<ptrdiff_t>(i); };
  const size_t from = Below(random, bytes->size() + 1);
  const size_t length = std::min(bytes->size() - from, size_t{1} << Below(random, 7));
  switch (random() % 6) {
    case 0: bytes->erase(at(from), at(from + length)); break;
    case 1: bytes->resize(from); break;
    case 2: {
      const Bytes again(at(from), at(from + length));
      bytes->insert(at(from), again.begin(), again.end());
      break;
    }
    case 3: {
      const Bytes& other = files[Below(random, files.size())];
      const size_t begin = Below(random, other.size() + 1);
      const size_t end = std::min(other.size(), begin + length);
      bytes->erase(at(from), at(std::min(bytes->size(), from + end - begin)));
      bytes->insert(at(from), other.begin() + static_cast<ptrdiff_t>(begin),
                    other.begin() + static_cast<ptrdiff_t>(end));
      break;
    }
    case 4:
      for (size_t i = from; i < from + length; ++i) (*bytes)[i] = static_cast<uint8_t>(random());
      break;
    default:
      if (from < bytes->size()) {
        (*bytes)[from] = static_cast<uint8_t>((*bytes)[from] ^ (1 << random() % 8));
      }
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argc > 4) return 2;
  std::vector<std::filesystem::path> paths;
  for (const auto& entry : std::filesystem::directory_iterator(argv[1])) {
    paths.push_back(entry.path());
  }
  std::sort(paths.begin(), paths.end());
  std::vector<Bytes> files;
  for (const auto& path : paths) {
    std::ifstream file(path, std::ios::binary);
    files.emplace_back(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
    LLVMFuzzerTestOneInput(files.back().data(), files.back().size());
  }
  std::printf("%zu inputs\n", files.size());
  if (files.empty()) return 1;
  const uint64_t count = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 0;
  const uint64_t seed = argc > 3 ? std::strtoull(argv[3], nullptr, 10) : 1;
  for (uint64_t i = 0; i < count; ++i) {
    Random random(seed + i);  // so that SEED + i, 1 repeats the i-th
    Bytes bytes = files[Below(random, files.size())];
    for (size_t changes = 1 + Below(random, 8); changes > 0; --changes) {
      Change(files, random, &bytes);
    }
    if (i % 1024 == 0) {
      std::printf("%llu of %llu\n", static_cast<unsigned long long>(i),
                  static_cast<unsigned long long>(count));
      std::fflush(stdout);
    }
    LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
  }
  if (count > 0) std::printf("%llu changed inputs\n", static_cast<unsigned long long>(count));
  return 0;
}
