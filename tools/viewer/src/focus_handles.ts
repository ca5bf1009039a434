// SPDX-License-Identifier: Apache-2.0
// The region of interest in the scene: its outline, and handles that are dragged.
import * as three from 'three';
import {add, cross, dot, length, scale, sub, unit, unitsPerPixel, type Point, type Region} from './query';
import type {Navigation} from './navigation';

interface Handle {
  place: Point;
  colour: number;
  name: string;
  // The region when the pointer is at this ray; `depth` is the handle's when it was taken.
  drag(ray: {origin: Point; direction: Point}, depth: number): Region;
}

const kAxisColours = [0xe0574a, 0x5aa845, 0x4a86e0];
const kCentreColour = 0xf0b429;
const kAxes: Point[] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

// How far along `axis` from `start` the line comes closest to the ray.
function alongAxis(start: Point, axis: Point, ray: {origin: Point; direction: Point}): number {
  const d = unit(ray.direction), w = sub(start, ray.origin), b = dot(axis, d), denominator = 1 - b * b;
  if (denominator < 1e-6) return 0;
  return (b * dot(d, w) - dot(axis, w)) / denominator;
}

export class FocusHandles {
  readonly root = new three.Group();
  region: Region | null = null;
  private handles: Handle[] = [];
  private readonly dots: three.Mesh[] = [];
  private readonly lines: three.LineSegments;
  private readonly hidden: three.LineSegments;
  private held: {handle: number; pointer: number; depth: number; grip: Point} | null = null;
  private readonly ball = new three.SphereGeometry(1, 20, 14);

  // `changed` is called with each new region.
  constructor(private readonly element: HTMLElement, private readonly navigation: Navigation, private readonly changed: (region: Region) => void) {
    const geometry = new three.BufferGeometry();
    this.lines = new three.LineSegments(geometry, new three.LineBasicMaterial({color: kCentreColour}));
    this.hidden = new three.LineSegments(geometry, new three.LineBasicMaterial({color: kCentreColour, transparent: true, opacity: 0.25, depthTest: false}));
    this.lines.frustumCulled = this.hidden.frustumCulled = false;
    this.lines.renderOrder = 3;
    this.hidden.renderOrder = 2;
    this.root.add(this.lines, this.hidden);
    element.addEventListener('pointerdown', e => this.onDown(e), {capture: true});
    element.addEventListener('pointermove', e => this.onMove(e), {capture: true});
    for (const name of ['pointerup', 'pointercancel'] as const) element.addEventListener(name, e => this.onUp(e), {capture: true});
  }

  get dragging() {
    return this.held !== null;
  }

  set(region: Region | null) {
    this.region = region;
    this.root.visible = region !== null;
    this.handles = region ? this.handlesOf(region) : [];
    while (this.dots.length < this.handles.length) {
      const dot = new three.Mesh(this.ball, new three.MeshBasicMaterial({depthTest: false, transparent: true, opacity: 0.92}));
      dot.renderOrder = 4;
      dot.frustumCulled = false;
      this.dots.push(dot);
      this.root.add(dot);
    }
    this.dots.forEach((dot, i) => (dot.visible = i < this.handles.length));
    if (region) this.draw(region);
  }

  // Handles have one size on the screen.
  update() {
    const eye = this.navigation.eye(), height = this.element.clientHeight;
    this.handles.forEach((handle, i) => {
      const dot = this.dots[i]!;
      dot.position.copy(this.navigation.toScene(handle.place));
      const size = unitsPerPixel({eye, target: eye, fov: this.navigation.camera.fov, viewport: [1, height]}, length(sub(handle.place, eye)));
      dot.scale.setScalar(size * (this.held?.handle === i ? 9 : 7));
      (dot.material as three.MeshBasicMaterial).color.setHex(handle.colour);
    });
  }

  // Where the handles are on the page, in CSS pixels, by name.
  places(): Record<string, [number, number]> {
    const result: Record<string, [number, number]> = {};
    for (const handle of this.handles) {
      const p = this.onScreen(handle.place);
      if (p) result[handle.name] = p;
    }
    return result;
  }

  private onScreen(place: Point): [number, number] | null {
    const p = this.navigation.toScene(place).project(this.navigation.camera);
    if (p.z > 1 || p.z < -1) return null;
    return [((p.x + 1) / 2) * this.element.clientWidth, ((1 - p.y) / 2) * this.element.clientHeight];
  }

  private handlesOf(region: Region): Handle[] {
    const inPlane = (from: Point, ray: {origin: Point; direction: Point}, depth: number) => sub(add(ray.origin, scale(ray.direction, depth)), from);
    if ('box' in region) {
      const {min, max} = region.box;
      const centre = scale(add(min, max), 0.5);
      const handles: Handle[] = [{place: centre, colour: kCentreColour, name: 'centre', drag: (ray, depth) => {
        const move = inPlane(centre, ray, depth);
        return {box: {min: add(min, move), max: add(max, move)}};
      }}];
      for (let k = 0; k < 3; ++k) {
        for (const upper of [false, true]) {
          const place = [...centre] as Point;
          place[k] = (upper ? max : min)[k]!;
          handles.push({place, colour: kAxisColours[k]!, name: (upper ? 'max' : 'min') + 'xyz'[k], drag: ray => {
            const moved = place[k]! + alongAxis(place, kAxes[k]!, ray);
            const box = {min: [...min] as Point, max: [...max] as Point};
            if (upper) box.max[k] = Math.max(moved, min[k]!);
            else box.min[k] = Math.min(moved, max[k]!);
            return {box};
          }});
        }
      }
      return handles;
    }
    if ('sphere' in region) {
      const {centre, radius} = region.sphere;
      return [{place: centre, colour: kCentreColour, name: 'centre', drag: (ray, depth) => ({sphere: {centre: add(centre, inPlane(centre, ray, depth)), radius}})},
        ...kAxes.map((axis, k): Handle => ({place: add(centre, scale(axis, radius)), colour: kAxisColours[k]!, name: 'radius' + 'xyz'[k],
          drag: ray => ({sphere: {centre, radius: Math.max(0, radius + alongAxis(add(centre, scale(axis, radius)), axis, ray))}})}))];
    }
    const {point, normal} = region.half_space;
    const n = unit(normal), arm = this.navigation.radius() * 0.35, tip = add(point, scale(n, arm));
    return [{place: point, colour: kCentreColour, name: 'centre', drag: ray => ({half_space: {point: add(point, scale(n, alongAxis(point, n, ray))), normal: n}})},
      {place: tip, colour: kAxisColours[2]!, name: 'normal', drag: (ray, depth) => {
        const to = sub(add(ray.origin, scale(ray.direction, depth)), point);
        return {half_space: {point, normal: length(to) > 0 ? unit(to) : n}};
      }}];
  }

  private draw(region: Region) {
    const points: Point[] = [];
    const line = (a: Point, b: Point) => points.push(a, b);
    if ('box' in region) {
      const corner = (i: number) => [0, 1, 2].map(k => ((i >> k) & 1 ? region.box.max : region.box.min)[k]!) as Point;
      for (let i = 0; i < 8; ++i) for (let k = 0; k < 3; ++k) if (!((i >> k) & 1)) line(corner(i), corner(i | (1 << k)));
    } else if ('sphere' in region) {
      const {centre, radius} = region.sphere;
      for (let k = 0; k < 3; ++k) {
        const at = (i: number) => add(centre, add(scale(kAxes[(k + 1) % 3]!, radius * Math.cos((i * Math.PI) / 36)), scale(kAxes[(k + 2) % 3]!, radius * Math.sin((i * Math.PI) / 36))));
        for (let i = 0; i < 72; ++i) line(at(i), at(i + 1));
      }
    } else {
      const {point, normal} = region.half_space;
      const n = unit(normal), side = unit(cross(n, Math.abs(n[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0])), other = cross(n, side), size = this.navigation.radius();
      const at = (i: number, j: number) => add(point, add(scale(side, i * size), scale(other, j * size)));
      for (let i = -2; i <= 2; ++i) {
        line(at(i / 2, -1), at(i / 2, 1));
        line(at(-1, i / 2), at(1, i / 2));
      }
      line(point, add(point, scale(n, this.navigation.radius() * 0.35)));
    }
    const array = new Float32Array(points.flatMap(p => this.navigation.toScene(p).toArray()));
    this.lines.geometry.setAttribute('position', new three.BufferAttribute(array, 3));
  }

  private atPointer(event: PointerEvent) {
    const box = this.element.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top] as const;
  }

  private onDown(event: PointerEvent) {
    if (!this.region || event.button !== 0 || this.held) return;
    const [x, y] = this.atPointer(event);
    let best = event.pointerType === 'touch' ? 26 : 14, found = -1;
    this.handles.forEach((handle, i) => {
      const p = this.onScreen(handle.place);
      const distance = p ? Math.hypot(p[0] - x, p[1] - y) : Infinity;
      if (distance < best) [best, found] = [distance, i];
    });
    if (found < 0) return;
    const forward = this.navigation.camera.getWorldDirection(new three.Vector3()).toArray() as Point;
    this.held = {handle: found, pointer: event.pointerId, depth: dot(sub(this.handles[found]!.place, this.navigation.eye()), forward), grip: [0, 0, 0]};
    this.element.setPointerCapture(event.pointerId);
    event.stopImmediatePropagation();
    event.preventDefault();
  }

  private onMove(event: PointerEvent) {
    if (!this.held || event.pointerId !== this.held.pointer) return;
    event.stopImmediatePropagation();
    const region = this.handles[this.held.handle]!.drag(this.navigation.ray(...this.atPointer(event)), this.held.depth);
    this.set(region);
    this.changed(region);
  }

  private onUp(event: PointerEvent) {
    if (!this.held || event.pointerId !== this.held.pointer) return;
    event.stopImmediatePropagation();
    this.held = null;
  }
}

export function regionFor(kind: string, centre: Point, size: number): Region | null {
  const half: Point = [size, size, size];
  if (kind === 'box') return {box: {min: sub(centre, half), max: add(centre, half)}};
  if (kind === 'sphere') return {sphere: {centre, radius: size}};
  if (kind === 'half_space') return {half_space: {point: centre, normal: [1, 0, 0]}};
  return null;
}

// The numbers of a region, in the order in which the page shows them.
export function numbersOf(region: Region): number[] {
  if ('box' in region) return [...region.box.min, ...region.box.max];
  if ('sphere' in region) return [...region.sphere.centre, region.sphere.radius];
  return [...region.half_space.point, ...region.half_space.normal];
}

// Null for numbers that make none.
export function regionOf(kind: string, n: number[]): Region | null {
  if (n.some(x => !Number.isFinite(x))) return null;
  const p = (i: number) => [n[i], n[i + 1], n[i + 2]] as Point;
  if (kind === 'box' && n.length === 6 && [0, 1, 2].every(k => n[k]! <= n[k + 3]!)) return {box: {min: p(0), max: p(3)}};
  if (kind === 'sphere' && n.length === 4 && n[3]! >= 0) return {sphere: {centre: p(0), radius: n[3]!}};
  if (kind === 'half_space' && n.length === 6 && length(p(3)) > 0) return {half_space: {point: p(0), normal: p(3)}};
  return null;
}

export const kindOf = (region: Region) => Object.keys(region)[0]!;
