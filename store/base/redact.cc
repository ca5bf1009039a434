// SPDX-License-Identifier: Apache-2.0
#include "store/base/redact.h"

#include <algorithm>
#include <array>

namespace mtdb {
namespace {

bool IsBlank(char c) { return static_cast<unsigned char>(c) <= ' ' || c == '\x7f'; }
bool IsQuote(char c) { return c == '"' || c == '\'' || c == '<' || c == '>' || c == '`'; }
bool IsLetter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); }
bool IsDigit(char c) { return c >= '0' && c <= '9'; }
char Lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

// What a message has behind a URL.
bool EndsSentence(char c) { return c == ':' || c == ',' || c == ';' || c == '.' || c == ')'; }

// Where the scheme before "://" or ":/" at `colon` begins; colon when there is none.
size_t SchemeBegin(std::string_view word, size_t colon) {
  size_t begin = colon;
  while (begin > 0 &&
         (IsLetter(word[begin - 1]) || IsDigit(word[begin - 1]) || word[begin - 1] == '+' ||
          word[begin - 1] == '-' || word[begin - 1] == '.')) {
    --begin;
  }
  return begin;
}

// "host:80", "[::1]:80" or "host" end in digits behind a colon or have none.
bool HasPortOnly(std::string_view authority) {
  const size_t bracket = authority.rfind(']');
  const size_t colon = authority.find(':', bracket == authority.npos ? 0 : bracket);
  if (colon == authority.npos) return true;
  std::string_view port = authority.substr(colon + 1);
  while (!port.empty() && (EndsSentence(port.back()) || IsQuote(port.back())))
    port.remove_suffix(1);
  return std::ranges::all_of(port, IsDigit);
}

// Of a word from behind the slashes of its scheme on: without user and password.
std::string_view WithoutUser(std::string_view rest) {
  const size_t end = std::min(rest.find_first_of("/?#"), rest.size());
  const size_t at = rest.substr(0, end).rfind('@');
  if (at != rest.npos) return rest.substr(at + 1);
  // A password may have a slash that should have been encoded.
  const size_t later = rest.rfind('@');
  if (later != rest.npos && !HasPortOnly(rest.substr(0, end))) return rest.substr(later + 1);
  return rest;
}

bool IsSecretName(std::string_view name) {
  std::string lower(name);
  std::ranges::transform(lower, lower.begin(), Lower);
  constexpr std::array<std::string_view, 13> kWords{
      "signature", "credential", "token",      "secret", "password", "passwd", "pwd",
      "accesskey", "access_key", "access-key", "apikey", "api_key",  "auth"};
  if (std::ranges::any_of(kWords, [&](auto w) { return lower.find(w) != lower.npos; })) return true;
  return lower == "sig" || lower == "key" || lower == "googleaccessid" || lower == "key-pair-id" ||
         lower == "policy";
}

// What follows '?', '#', '&' or ';' as NAME=VALUE loses the value where the name says so.
std::string WithoutValues(std::string_view word) {
  std::string out;
  size_t from = 0;
  for (size_t i = 0; i < word.size(); ++i) {
    if (word[i] != '?' && word[i] != '#' && word[i] != '&' && word[i] != ';') continue;
    const size_t equals = word.find('=', i);
    if (equals == word.npos) break;
    if (!IsSecretName(word.substr(i + 1, equals - i - 1))) continue;
    size_t end = equals + 1;
    while (end < word.size() && word[end] != '&' && word[end] != ';' && !IsQuote(word[end])) ++end;
    out += word.substr(from, equals + 1 - from);
    out += "...";
    from = end;
    i = end - 1;
  }
  out += word.substr(from);
  return out;
}

// AKIA..., ASIA...: twenty capital letters and digits.
std::string WithoutKeyIds(std::string word) {
  constexpr size_t kKeyId = 20;
  for (const std::string_view start : {"AKIA", "ASIA"}) {
    for (size_t at = word.find(start); at != word.npos; at = word.find(start, at + start.size())) {
      size_t end = at;
      while (end < word.size() && ((word[end] >= 'A' && word[end] <= 'Z') || IsDigit(word[end]))) {
        ++end;
      }
      if (end - at >= kKeyId) word.replace(at + start.size(), end - at - start.size(), "...");
    }
  }
  return word;
}

// One word of a text: what has no blank in it.
std::string Redacted(std::string_view word) {
  std::string out;
  for (;;) {
    size_t colon = word.find(":/");
    while (colon != word.npos && SchemeBegin(word, colon) == colon) {
      colon = word.find(":/", colon + 1);
    }
    if (colon == word.npos) break;
    size_t slashes = colon + 1;
    while (slashes < word.size() && word[slashes] == '/') ++slashes;
    out += WithoutValues(word.substr(0, slashes));
    word = WithoutUser(word.substr(slashes));
    const size_t query = word.find('?');
    size_t end = query == word.npos ? word.size() : query;
    // Another URL may follow in the same word, as in a list; what is between is kept.
    const size_t next = word.substr(0, end).find("://");
    if (next != word.npos) end = SchemeBegin(word, next);
    out += WithoutValues(word.substr(0, end));
    word.remove_prefix(end);
    if (word.empty() || word[0] != '?') continue;
    size_t dropped = 0;
    while (dropped < word.size() && !IsQuote(word[dropped])) ++dropped;
    // A quote in a signature is no end of it when more of the query follows.
    const size_t more = word.find('=', dropped);
    if (more != word.npos) dropped = word.size();
    while (dropped > 1 && EndsSentence(word[dropped - 1])) --dropped;
    word.remove_prefix(dropped);
  }
  out += WithoutValues(word);
  return WithoutKeyIds(std::move(out));
}

}  // namespace

std::string WithoutSecrets(std::string_view text) {
  std::string out;
  for (size_t i = 0; i < text.size();) {
    size_t end = i;
    while (end < text.size() && IsBlank(text[end]) == IsBlank(text[i])) ++end;
    const std::string_view word = text.substr(i, end - i);
    out += IsBlank(word[0]) ? std::string(word) : Redacted(word);
    i = end;
  }
  return out;
}

}  // namespace mtdb
