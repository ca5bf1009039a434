// SPDX-License-Identifier: Apache-2.0
// Letters on pictures, and what is explained by them: legends and scale bars.
#pragma once

#include <string>
#include <string_view>

#include "tools/render/render.h"

namespace mtdb::internal {

// Pixels that one dot of a letter takes in a picture of this height.
int DotSize(int image_height);
// Of a line of text, in dots; it is 7 high.
int TextWidth(std::string_view text);
// Draws from (x, y), the upper left corner, in white with a dark rim. What lies outside of the
// image is left out; bytes that are no ASCII become '?'.
void DrawText(RenderImage* image, int x, int y, int dot, std::string_view text);

// What a legend says: the colours from the least to the largest value, and what they are of.
struct Legend {
  std::string title, units;
  double least = 0, most = 0;
  Rgb (*colour)(double t) = ColourOfValue;
};
// A bar of the colours at the right, with the ends of the range.
void DrawLegend(RenderImage* image, const Legend& legend);
// At the lower left: a length of 1, 2 or 5 times a power of ten, where a model unit takes so many
// pixels.
void DrawScaleBar(RenderImage* image, double pixels_per_unit);

}  // namespace mtdb::internal
