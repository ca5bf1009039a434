// SPDX-License-Identifier: Apache-2.0
// The shaders of all meshes and of their edges.
import * as three from 'three';
import {kCell, kPageTexels, kTableWidth} from './page_table';

const vertex = `
precision highp float;
in vec3 position;
in vec4 normal;
in vec4 colour;
in float scalar;
#ifdef TEXTURED
in vec2 corner;              // u, v
in uint page;                // of the triangle
flat out uint inPage;
out vec2 cornerSteps;        // onPage, for its derivatives alone
centroid out vec2 onPage;
#endif
uniform mat4 modelViewMatrix, projectionMatrix;
uniform mat3 normalMatrix;
uniform vec3 place, stretch; // of the mesh in the scene; see stretch.ts
uniform vec3 up;
uniform float lean;          // of what heights are drawn, once they were exaggerated
uniform int colourBy;        // 0 plain, 1 vertex colours, 2 scalar, 3 height, 4 steepness, 5 permitted error, 6 scalar by its logarithm, 7 a colour for each value of the scalar, 8 texture
uniform vec2 range;          // of what the colour map shows
uniform vec2 imageMiddle, imageAcross, imageDown; // from the mesh's origin; see placed_image.ts
out vec3 inView, inScene;
out vec2 imageSteps;         // inImage, for its derivatives alone
// Not beyond the triangle: of a triangle that is seen from its side, that would be far off.
centroid out vec3 normalInView, plain;
centroid out float level;
centroid out vec2 inImage;
void main() {
  vec3 placed = position * stretch;
  vec4 view = modelViewMatrix * vec4(placed, 1.0);
  gl_Position = projectionMatrix * view;
  inView = view.xyz;
  inScene = place + placed;
  vec2 fromMiddle = position.xy - imageMiddle;
  inImage = imageSteps = 0.5 + vec2(dot(imageAcross, fromMiddle), dot(imageDown, fromMiddle));
  normalInView = normalMatrix * vec3(normal.xy, normal.z * lean);
  plain = colour.rgb;
#ifdef TEXTURED
  inPage = page;
  onPage = cornerSteps = vec2(corner.x, 1.0 - corner.y); // pages have their first row above
#endif
  if (colourBy == 6) level = range.y > range.x ? log(max(scalar, range.x) / range.x) / log(range.y / range.x) : 0.5;
  if (colourBy == 7) level = fract(scalar * 0.6180339887);
  if (colourBy > 5) return;
  float shown = colourBy == 2 ? scalar : colourBy == 3 ? dot(inScene, up) : degrees(acos(clamp(abs(dot(normal.xyz, up)) / max(length(normal.xyz), 1e-6), 0.0, 1.0)));
  level = range.y > range.x ? (shown - range.x) / (range.y - range.x) : 0.5;
}`;

const clipping = `
uniform int planeCount;   // of the region
uniform vec4 planes[6];   // outside: dot(planes[i], vec4(p, 1)) > 0
uniform vec4 ball;        // centre and radius; a negative radius: none
uniform bool clips;       // what is outside goes
float outside(vec3 p) {
  float result = ball.w < 0.0 ? -1e30 : distance(p, ball.xyz) - ball.w;
  for (int i = 0; i < planeCount; ++i) result = max(result, dot(planes[i], vec4(p, 1.0)));
  return result;
}`;

// The texture in tiles; page_table.ts has the tables.
const texturing = `
#ifdef TEXTURED
flat in uint inPage;
in vec2 cornerSteps;
centroid in vec2 onPage;
uniform highp sampler2DArray tiles; // premultiplied
uniform highp usampler2D pages;     // kPageTexels of each page: width, height, levels, then where the entries of each level begin
uniform highp usampler2D entries;   // of each tile of each level: what shows it best
uniform int pageCount;
uniform float book;                 // which object asks
uniform float levelBias, sharper;   // how much coarser than a texel a pixel; how many pixels along a slope one texel may cover
const int kPageTexels = PAGE_TEXELS, kTableWidth = TABLE_WIDTH;
const float kSquare = 504.0, kMargin = 4.0, kCell = CELL, kLayer = 4.0 * kCell;

uint look(highp usampler2D table, int i) {
  return texelFetch(table, ivec2(i % kTableWidth, i / kTableWidth), 0).r;
}
struct Place {
  vec2 at;            // in pixels of level 0
  vec2 right, up;     // how these change from pixel to pixel
  ivec2 size;
  int first, levels;  // of the page
  float level;        // that is wanted
};
bool place(out Place p) {
  vec2 right = dFdx(cornerSteps), up = dFdy(cornerSteps);
  if (inPage >= uint(pageCount)) return false;
  p.first = int(inPage) * kPageTexels;
  p.size = ivec2(look(pages, p.first), look(pages, p.first + 1));
  p.levels = int(look(pages, p.first + 2));
  if (p.levels == 0) return false;
  vec2 size = vec2(p.size);
  // The last column is not the first one.
  p.at = mix(fract(onPage), onPage, equal(onPage, clamp(onPage, 0.0, 1.0))) * size;
  p.right = right * size;
  p.up = up * size;
  float longer = sqrt(max(max(dot(p.right, p.right), dot(p.up, p.up)), 1e-12));
  float shorter = abs(p.right.x * p.up.y - p.right.y * p.up.x) / longer;
  p.level = clamp(log2(max(max(shorter, longer / sharper), 1e-6)) + levelBias, 0.0, float(p.levels - 1));
  return true;
}
// The entry of the tile of a level that shows the place.
int entryOf(Place p, int level, out ivec2 tile) {
  ivec2 side = (p.size + (1 << level) - 1) >> level;
  ivec2 count = (side + int(kSquare) - 1) / int(kSquare);
  tile = clamp(ivec2(floor(p.at / exp2(float(level)) / kSquare)), ivec2(0), count - 1);
  return int(look(pages, p.first + 3 + level)) + tile.y * count.x + tile.x;
}
vec4 colourAt(Place p, int level) {
  ivec2 tile;
  uint entry = look(entries, entryOf(p, level, tile));
  if (entry == 0u) return vec4(0.0);
  int stored = int(entry >> 14 & 31u); // level
  float texel = exp2(float(stored));
  vec2 inTile = p.at / texel - kSquare * vec2(tile >> (stored - level)) + kMargin;
  vec2 corner = kCell * vec2(float(entry >> 10 & 3u), float(entry >> 12 & 3u));
  return textureGrad(tiles, vec3((corner + inTile) / kLayer, float(entry & 1023u)), p.right / texel / kLayer, p.up / texel / kLayer);
}
vec4 textureHere() {
  Place p;
  if (!place(p)) return vec4(0.0);
  int level = int(p.level);
  vec4 fine = colourAt(p, level);
  float part = fract(p.level);
  return part > 0.0 ? mix(fine, colourAt(p, level + 1), part) : fine;
}
// Which tile would be shown here, if all were there.
vec4 askHere() {
  Place p;
  // Triangles that lie in a point of the page show what is there.
  if (!place(p) || max(dot(p.right, p.right), dot(p.up, p.up)) < 1e-9) return vec4(0.0);
  ivec2 tile;
  int entry = entryOf(p, int(p.level), tile);
  return vec4(float(entry & 255), float(entry >> 8 & 255), float(entry >> 16 & 255), book) / 255.0;
}
#endif
`;

const fragment = `
precision highp float;
precision highp int;
in vec3 inView, inScene;
in vec2 imageSteps;
centroid in vec3 normalInView, plain;
centroid in float level;
centroid in vec2 inImage;
uniform bool asks;            // which tiles of textures are wanted
uniform int colourBy, valued; // valued: what the object's vertices have, 1 or 2
uniform bool flatShading;
uniform int backFaces;        // 0 as the front, 1 in a colour of their own, 2 that without light, as the filling of a section
uniform vec3 surface, back, mark, light;   // colours as on screens; the direction to the light, in view
uniform vec3 weights;         // of light, sky, and what comes from the eye
uniform vec4 permitted;       // error a unit of depth; inside of the region: 0 the same, 1 .y, 2 .y a unit of distance from apex; .z: what; .w: outside anything
uniform vec3 apex;
uniform vec2 range;
uniform sampler2D map;
uniform bool draped;
uniform sampler2D image;      // premultiplied
out vec4 result;
${clipping}
${texturing}
float permittedLevel(float o) {
  float error = o > 0.0 && permitted.w > 0.0 ? range.y : permitted.x * -inView.z;
  if (o <= 0.0 && permitted.z == 1.0) error = permitted.y;
  if (o <= 0.0 && permitted.z == 2.0) error = permitted.y * distance(inScene, apex);
  return log(max(error, 1e-30) / range.x) / log(range.y / range.x);
}
void main() {
  float o = outside(inScene);
  if (clips && o > 0.0) discard;
  if (asks) {
#ifdef TEXTURED
    result = askHere();
#else
    result = vec4(0.0);
#endif
    return;
  }
  vec3 toEye = normalize(-inView), n;
  bool behind = !gl_FrontFacing;
  if (flatShading || dot(normalInView, normalInView) == 0.0) {
    n = normalize(cross(dFdx(inView), dFdy(inView)));
  } else {
    n = normalize(normalInView);
    // Slivers behind a crest, whose normals are the crest's, are shaded as the crest.
    if (dot(n, toEye) > 0.0) behind = false;
    else if (behind) n = -n;
    // A normal of the front that looks away from the eye is that of a silhouette or of a crease.
    float away = dot(n, toEye);
    if (away < 0.0) n = normalize(n - away * toEye);
  }
  float shown = colourBy == 5 ? permittedLevel(o) : level;
  vec3 base = colourBy == 0 || colourBy == 8 || ((colourBy == 1 || colourBy == 2) && valued != colourBy) ? surface : colourBy == 1 ? plain : texture(map, vec2((clamp(shown, 0.0, 1.0) * 255.0 + 0.5) / 256.0, 0.5)).rgb;
#ifdef TEXTURED
  vec4 shownHere = textureHere();
  base = base * (1.0 - shownHere.a) + shownHere.rgb;
#endif
  vec2 stepRight = dFdx(imageSteps), stepUp = dFdy(imageSteps);
  if (draped && inImage == clamp(inImage, 0.0, 1.0)) {
    vec4 over = textureGrad(image, inImage, stepRight, stepUp);
    base = base * (1.0 - over.a) + over.rgb;
  }
  if (backFaces > 0 && behind) base = back;
  if (backFaces == 2 && clips && behind) {
    result = vec4(back, 1.0);
    return;
  }
  // Where the region's border meets the surface.
  if (!clips && abs(o) < 1.3 * fwidth(o)) base = mark;
  base = pow(base, vec3(2.2));
  float key = max(dot(n, light), 0.0);
  float fill = 0.5 + 0.5 * n.y;
  float head = max(dot(n, toEye), 0.0);
  vec3 halfway = normalize(light + toEye);
  float shine = 0.12 * pow(max(dot(n, halfway), 0.0), 30.0);
  vec3 lit = weights == vec3(0.0) ? base : base * dot(weights, vec3(key, fill, head)) + shine;
  result = vec4(pow(lit, vec3(1.0 / 2.2)), 1.0);
}`;

const edgeFragment = `
precision highp float;
precision highp int;
in vec3 inScene;
uniform vec3 edge;
uniform float edgeOpacity;
out vec4 result;
${clipping}
uniform bool asks;
void main() {
  if (asks || (clips && outside(inScene) > 0.0)) discard;
  result = vec4(edge, edgeOpacity);
}`;

// Numbers for the shader; kTableWidth a row, or one.
export function tableTexture(data: Uint32Array<ArrayBuffer>): three.DataTexture {
  const width = Math.min(kTableWidth, data.length);
  const texture = new three.DataTexture(
    data,
    width,
    data.length / width,
    three.RedIntegerFormat,
    three.UnsignedIntType,
  );
  texture.needsUpdate = true;
  return texture;
}

export type Uniforms = Record<string, {value: unknown}>;

// What all meshes share; `place` is each mesh's own.
export function sharedUniforms(): Uniforms {
  const map = new three.DataTexture(new Uint8Array(4 * 256), 256, 1);
  map.magFilter = map.minFilter = three.LinearFilter;
  return {
    colourBy: {value: 0},
    range: {value: new three.Vector2(0, 1)},
    stretch: {value: new three.Vector3(1, 1, 1)},
    up: {value: new three.Vector3(0, 0, 1)},
    lean: {value: 1},
    planeCount: {value: 0},
    planes: {value: Array.from({length: 6}, () => new three.Vector4())},
    ball: {value: new three.Vector4(0, 0, 0, -1)},
    clips: {value: false},
    asks: {value: false},
    tiles: {value: null},
    levelBias: {value: 0},
    sharper: {value: 1},
    flatShading: {value: false},
    backFaces: {value: 0},
    surface: {value: new three.Color()},
    mark: {value: new three.Color()},
    weights: {value: new three.Vector3()},
    permitted: {value: new three.Vector4()},
    apex: {value: new three.Vector3()},
    back: {value: new three.Color()},
    light: {value: new three.Vector3(0, 0, 1)},
    map: {value: map},
    edge: {value: new three.Color()},
    edgeOpacity: {value: 0.55},
  };
}

export function surfaceMaterial(shared: Uniforms, own: Uniforms, textured = false) {
  return new three.RawShaderMaterial({
    defines: textured
      ? {
          TEXTURED: '',
          PAGE_TEXELS: kPageTexels,
          TABLE_WIDTH: kTableWidth,
          CELL: kCell.toFixed(1),
        }
      : {},
    glslVersion: three.GLSL3,
    vertexShader: vertex,
    fragmentShader: fragment,
    uniforms: {...shared, ...own} as never,
    side: three.DoubleSide,
    polygonOffsetFactor: 1,
    polygonOffsetUnits: 1,
  });
}

export function edgeMaterial(shared: Uniforms, own: Uniforms) {
  return new three.RawShaderMaterial({
    glslVersion: three.GLSL3,
    vertexShader: vertex,
    fragmentShader: edgeFragment,
    uniforms: {...shared, ...own} as never,
    transparent: true,
    depthWrite: false,
  });
}
