// SPDX-License-Identifier: Apache-2.0
// The shaders of all meshes and of their edges.
import * as three from 'three';

const vertex = `
precision highp float;
in vec3 position;
in vec4 normal;
in vec4 colour;
in float scalar;
uniform mat4 modelViewMatrix, projectionMatrix;
uniform mat3 normalMatrix;
uniform vec3 place;     // of the mesh in the scene
uniform int colourBy;   // 0 plain, 1 vertex colours, 2 scalar, 3 height, 4 steepness
uniform vec2 range;     // of what the colour map shows
out vec3 inView, inScene, normalInView, plain;
out float level;
void main() {
  vec4 view = modelViewMatrix * vec4(position, 1.0);
  gl_Position = projectionMatrix * view;
  inView = view.xyz;
  inScene = place + position;
  normalInView = normalMatrix * normal.xyz;
  plain = colour.rgb;
  float shown = colourBy == 2 ? scalar : colourBy == 3 ? inScene.z : degrees(acos(clamp(abs(normal.z) / max(length(normal.xyz), 1e-6), 0.0, 1.0)));
  level = range.y > range.x ? (shown - range.x) / (range.y - range.x) : 0.5;
}`;

const clipping = `
uniform int clipKind;   // 0 none, 1 box, 2 ball, 3 half-space
uniform vec3 clipA, clipB;
bool isClipped(vec3 p) {
  if (clipKind == 1) return any(lessThan(p, clipA)) || any(greaterThan(p, clipB));
  if (clipKind == 2) return distance(p, clipA) > clipB.x;
  if (clipKind == 3) return dot(p - clipA, clipB) > 0.0;
  return false;
}`;

const fragment = `
precision highp float;
precision highp int;
in vec3 inView, inScene, normalInView, plain;
in float level;
uniform int colourBy;
uniform bool flatShading, showBack;
uniform vec3 surface, back, light;   // colours as on screens; the direction to the light, in view
uniform sampler2D map;
out vec4 result;
${clipping}
void main() {
  if (isClipped(inScene)) discard;
  vec3 facet = normalize(cross(dFdx(inView), dFdy(inView)));
  vec3 n = facet;
  if (!flatShading && dot(normalInView, normalInView) > 0.0) {
    n = normalize(normalInView);
    if (!gl_FrontFacing) n = -n;
    // A normal that looks away from the eye is that of a silhouette or of a crease.
    if (dot(n, facet) < 0.0) n = normalize(n - 2.0 * dot(n, facet) * facet);
  }
  vec3 base = colourBy == 0 ? surface : colourBy == 1 ? plain : texture(map, vec2((clamp(level, 0.0, 1.0) * 255.0 + 0.5) / 256.0, 0.5)).rgb;
  if (showBack && !gl_FrontFacing) base = back;
  base = pow(base, vec3(2.2));
  float key = max(dot(n, light), 0.0);
  float fill = 0.5 + 0.5 * n.y;
  float head = max(dot(n, normalize(-inView)), 0.0);
  vec3 halfway = normalize(light + normalize(-inView));
  float shine = 0.12 * pow(max(dot(n, halfway), 0.0), 30.0);
  vec3 lit = base * (0.62 * key + 0.14 * fill + 0.26 * head) + shine;
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
void main() {
  if (isClipped(inScene)) discard;
  result = vec4(edge, edgeOpacity);
}`;

export type Uniforms = Record<string, {value: unknown}>;

// What all meshes share; `place` is each mesh's own.
export function sharedUniforms(): Uniforms {
  const map = new three.DataTexture(new Uint8Array(4 * 256), 256, 1);
  map.magFilter = map.minFilter = three.LinearFilter;
  return {
    colourBy: {value: 0}, range: {value: new three.Vector2(0, 1)}, clipKind: {value: 0}, clipA: {value: new three.Vector3()},
    clipB: {value: new three.Vector3()}, flatShading: {value: false}, showBack: {value: false}, surface: {value: new three.Color()},
    back: {value: new three.Color()}, light: {value: new three.Vector3(0, 0, 1)}, map: {value: map}, edge: {value: new three.Color()},
    edgeOpacity: {value: 0.55},
  };
}

export function surfaceMaterial(shared: Uniforms, own: Uniforms) {
  return new three.RawShaderMaterial({
    glslVersion: three.GLSL3, vertexShader: vertex, fragmentShader: fragment, uniforms: {...shared, ...own} as never,
    side: three.DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
  });
}

export function edgeMaterial(shared: Uniforms, own: Uniforms) {
  return new three.RawShaderMaterial({
    glslVersion: three.GLSL3, vertexShader: vertex, fragmentShader: edgeFragment, uniforms: {...shared, ...own} as never, transparent: true, depthWrite: false,
  });
}
