// SPDX-License-Identifier: Apache-2.0
#include "store/carriers/http_url.h"

#include <algorithm>
#include <cstdlib>
#include <initializer_list>

#include "store/base/redact.h"

namespace mtdb::internal {
namespace {

std::string Variable(std::initializer_list<const char*> names) {
  for (const char* name : names) {
    const char* const value = std::getenv(name);
    if (value != nullptr && *value != '\0') return value;
  }
  return "";
}

// "%2E" and the like become what they stand for, however often they are encoded.
std::string Decoded(std::string text) {
  const auto digit = [](char c) {
    if (c >= '0' && c <= '9') return c - '0';
    const char lower = static_cast<char>(c | 0x20);
    return lower >= 'a' && lower <= 'f' ? lower - 'a' + 10 : -1;
  };
  for (size_t i = 0; i + 2 < text.size();) {
    const int high = text[i] == '%' ? digit(text[i + 1]) : -1;
    const int low = high < 0 ? -1 : digit(text[i + 2]);
    if (low < 0) {
      ++i;
      continue;
    }
    text.replace(i, 3, 1, static_cast<char>(high * 16 + low));
    i -= std::min<size_t>(i, 2);  // what is decoded may be the end of another one
  }
  return text;
}

// Whether one of the parts between slashes is "." or "..", which whoever serves it may take for
// a way out of the bucket.
bool HasDotSegment(const std::string& key) {
  const std::string plain = Decoded(key);
  for (size_t begin = 0; begin <= plain.size();) {
    const size_t end = std::min(plain.find_first_of("/\\", begin), plain.size());
    const std::string part = plain.substr(begin, end - begin);
    if (part == "." || part == "..") return true;
    begin = end + 1;
  }
  return false;
}

// As S3 wants it in a path and in what is signed.
std::string Encoded(const std::string& key) {
  const std::string plain = "-_.~/";
  std::string encoded;
  for (const char c : key) {
    const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
    if (letter || plain.find(c) != std::string::npos) {
      encoded += c;
    } else {
      const auto byte = static_cast<unsigned char>(c);
      encoded += '%';
      encoded += "0123456789ABCDEF"[byte >> 4];
      encoded += "0123456789ABCDEF"[byte & 15];
    }
  }
  return encoded;
}

Result<HttpPlace> PlaceInS3(const std::string& url) {
  const std::string rest = url.substr(5);
  const size_t slash = rest.find('/');
  const std::string bucket = rest.substr(0, slash);
  const std::string shown = WithoutSecrets(url);
  if (slash == std::string::npos || bucket.empty() || slash + 1 == rest.size()) {
    return InvalidArgument(shown + ": expected s3://BUCKET/KEY");
  }
  for (const char c : bucket) {
    const bool fits = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                      c == '-' || c == '.' || c == '_';
    if (!fits) {
      return InvalidArgument(shown + ": between s3:// and the next slash is no name of a bucket");
    }
  }
  if (HasDotSegment(rest)) {
    return InvalidArgument(shown +
                           ": expected no '.' or '..' between the slashes of bucket and key");
  }
  std::string region = Variable({"AWS_REGION", "AWS_DEFAULT_REGION"});
  if (region.empty()) region = "us-east-1";
  std::string endpoint = Variable({"AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL"});
  while (endpoint.ends_with('/')) endpoint.pop_back();
  HttpPlace place;
  place.shown = shown;
  const std::string key = Encoded(rest.substr(slash + 1));
  if (endpoint.empty()) {
    place.url = "https://" + bucket + ".s3." + region + ".amazonaws.com/" + key;
  } else if (endpoint.starts_with("http://") || endpoint.starts_with("https://")) {
    place.url = endpoint + "/" + bucket + "/" + key;
  } else {
    return InvalidArgument(shown + ": AWS_ENDPOINT_URL does not begin with http:// or https://");
  }
  const std::string id = Variable({"AWS_ACCESS_KEY_ID"});
  const std::string secret = Variable({"AWS_SECRET_ACCESS_KEY"});
  if (id.empty() != secret.empty()) {
    return InvalidArgument(shown +
                           ": of AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY one is missing");
  }
  if (!id.empty()) {
    place.signature_scope = "aws:amz:" + region + ":s3";
    place.credentials = id + ":" + secret;
    place.session_token = Variable({"AWS_SESSION_TOKEN"});
  }
  return place;
}

}  // namespace

Result<HttpPlace> PlaceOfUrl(const std::string& url) {
  for (const char c : url) {
    if (static_cast<unsigned char>(c) <= ' ' || c == '\x7f') {
      return InvalidArgument("a URL has no spaces or control characters; write %20 for a space");
    }
  }
  HttpPlace place;
  if (url.starts_with("s3://")) {
    MTDB_ASSIGN_OR_RETURN(place, PlaceInS3(url));
  } else {
    place.url = url;
    place.shown = WithoutSecrets(url);
  }
  place.certificates = Variable({"CURL_CA_BUNDLE", "SSL_CERT_FILE"});
  return place;
}

}  // namespace mtdb::internal
