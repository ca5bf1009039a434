// SPDX-License-Identifier: Apache-2.0
#include "store/internal/http_url.h"

#include <cstdlib>
#include <initializer_list>

namespace mtdb::internal {
namespace {

std::string Variable(std::initializer_list<const char*> names) {
  for (const char* name : names) {
    const char* const value = std::getenv(name);
    if (value != nullptr && *value != '\0') return value;
  }
  return "";
}

// What a message may show: no user and password, no query, which may have a signature.
std::string Shown(const std::string& url) {
  std::string shown = url.substr(0, url.find_first_of("?#"));
  const size_t host = shown.find("://") + 3;
  const size_t path = std::min(shown.find('/', host), shown.size());
  const size_t at = shown.rfind('@', path);
  if (at != std::string::npos && at >= host) shown.erase(host, at + 1 - host);
  return shown;
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
  if (slash == std::string::npos || bucket.empty() || slash + 1 == rest.size()) {
    return InvalidArgument(url + ": expected s3://BUCKET/KEY");
  }
  for (const char c : bucket) {
    const bool fits = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                      c == '-' || c == '.' || c == '_';
    if (!fits) return InvalidArgument(url + ": '" + bucket + "' is not the name of a bucket");
  }
  std::string region = Variable({"AWS_REGION", "AWS_DEFAULT_REGION"});
  if (region.empty()) region = "us-east-1";
  std::string endpoint = Variable({"AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL"});
  while (endpoint.ends_with('/')) endpoint.pop_back();
  HttpPlace place;
  place.shown = url;
  const std::string key = Encoded(rest.substr(slash + 1));
  if (endpoint.empty()) {
    place.url = "https://" + bucket + ".s3." + region + ".amazonaws.com/" + key;
  } else if (endpoint.starts_with("http://") || endpoint.starts_with("https://")) {
    place.url = endpoint + "/" + bucket + "/" + key;
  } else {
    return InvalidArgument(url + ": AWS_ENDPOINT_URL is '" + endpoint +
                           "', expected http(s)://...");
  }
  const std::string id = Variable({"AWS_ACCESS_KEY_ID"});
  const std::string secret = Variable({"AWS_SECRET_ACCESS_KEY"});
  if (id.empty() != secret.empty()) {
    return InvalidArgument(url + ": of AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY one is missing");
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
    place.shown = Shown(url);
  }
  place.certificates = Variable({"CURL_CA_BUNDLE", "SSL_CERT_FILE"});
  return place;
}

}  // namespace mtdb::internal
