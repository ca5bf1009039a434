// SPDX-License-Identifier: Apache-2.0
#include "tests/everything/step.h"

#include <charconv>
#include <cstdlib>

namespace mtdb::everything {

namespace {

bool IsPlain(char c) { return c > ' ' && c < 127 && c != '%' && c != '='; }

std::string Escaped(const std::string& text) {
  constexpr char kHex[] = "0123456789abcdef";
  std::string escaped;
  for (const char c : text) {
    if (IsPlain(c)) {
      escaped += c;
    } else {
      const auto byte = static_cast<unsigned char>(c);
      escaped += {'%', kHex[byte >> 4], kHex[byte & 15]};
    }
  }
  return escaped;
}

std::string Unescaped(std::string_view text) {
  std::string plain;
  for (size_t i = 0; i < text.size(); ++i) {
    unsigned value = 0;
    if (text[i] == '%' && i + 2 < text.size() &&
        std::from_chars(text.data() + i + 1, text.data() + i + 3, value, 16).ec == std::errc()) {
      plain += static_cast<char>(value);
      i += 2;
    } else {
      plain += text[i];
    }
  }
  return plain;
}

}  // namespace

std::string Step::Text(const std::string& key, const std::string& otherwise) const {
  const auto at = with.find(key);
  return at == with.end() ? otherwise : at->second;
}

double Step::Number(const std::string& key, double otherwise) const {
  const auto at = with.find(key);
  return at == with.end() ? otherwise : std::strtod(at->second.c_str(), nullptr);
}

int64_t Step::Int(const std::string& key, int64_t otherwise) const {
  const auto at = with.find(key);
  return at == with.end() ? otherwise : std::strtoll(at->second.c_str(), nullptr, 10);
}

void Step::Set(const std::string& key, double value) { with[key] = NumberText(value); }

std::string StepText(const Step& step) {
  std::string text = step.act;
  for (const auto& [key, value] : step.with) text += " " + key + "=" + Escaped(value);
  return text;
}

std::string WalkText(const Walk& walk) {
  std::string text = "# seed " + std::to_string(walk.seed) + "\n";
  for (const Step& step : walk.steps) text += StepText(step) + "\n";
  return text;
}

Result<Walk> ParseWalk(std::string_view text) {
  Walk walk;
  int number = 0;
  for (const std::string& line : Split(std::string(text), '\n')) {
    ++number;
    if (line.starts_with("# seed ")) walk.seed = std::strtoull(line.c_str() + 7, nullptr, 10);
    if (line.empty() || line[0] == '#') continue;
    Step step;
    for (const std::string& word : Split(line, ' ')) {
      if (word.empty()) continue;
      const size_t equals = word.find('=');
      if (step.act.empty() && equals == std::string::npos) {
        step.act = word;
      } else if (!step.act.empty() && equals != std::string::npos && equals > 0) {
        step.with[word.substr(0, equals)] = Unescaped(word.substr(equals + 1));
      } else {
        return BadInput("line " + std::to_string(number) +
                        ": expected 'act key=value ...', found " + line);
      }
    }
    walk.steps.push_back(std::move(step));
  }
  return walk;
}

std::vector<double> Numbers(const std::string& text) {
  std::vector<double> numbers;
  for (const std::string& part : Split(text, ',')) {
    char* end = nullptr;
    const double value = std::strtod(part.c_str(), &end);
    if (end != part.c_str()) numbers.push_back(value);
  }
  return numbers;
}

std::string NumberText(double value) {
  char buffer[64];
  const auto [end, error] = std::to_chars(buffer, buffer + sizeof(buffer), value);
  return {buffer, end};
}

std::vector<std::string> Split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  size_t begin = 0;
  for (size_t at = 0; at <= text.size(); ++at) {
    if (at < text.size() && text[at] != separator) continue;
    parts.push_back(text.substr(begin, at - begin));
    begin = at + 1;
  }
  return parts;
}

}  // namespace mtdb::everything
