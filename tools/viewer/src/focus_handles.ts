// SPDX-License-Identifier: Apache-2.0
// The region of interest in the scene: its outline, and handles that are dragged. All in the page's
// coordinates.
import * as three from 'three';
import type {Navigation} from './navigation';
import {add, cross, dot, length, scale, sub, unit, unitsPerPixel, type Point} from './query';
import {anglesOf, axesOf, turned, type Box, type Shape, type TurnedBox, type Wedge} from './shapes';

interface Ray {
  origin: Point;
  direction: Point;
}

interface Handle {
  place: Point;
  colour: number;
  name: string;
  turns?: Point; // around this axis
  // The shape when the pointer is at this ray; `depth` is the handle's when it was taken.
  drag(ray: Ray, depth: number): Shape;
}

const kAxisColours = [0xe0574a, 0x5aa845, 0x4a86e0];
const kCentreColour = 0xf0b429;
const kAxes: Point[] = [
  [1, 0, 0],
  [0, 1, 0],
  [0, 0, 1],
];

// How far along `axis` from `start` the line comes closest to the ray.
function alongAxis(start: Point, axis: Point, ray: Ray): number {
  const d = unit(ray.direction),
    w = sub(start, ray.origin),
    b = dot(axis, d),
    denominator = 1 - b * b;
  if (denominator < 1e-6) return 0;
  return (b * dot(d, w) - dot(axis, w)) / denominator;
}

const atDepth = (ray: Ray, depth: number) => add(ray.origin, scale(ray.direction, depth));

// Where the ray meets the horizontal plane at `z`, unless it hardly does.
function onPlane(ray: Ray, z: number, depth: number): Point {
  const d = unit(ray.direction),
    t = (z - ray.origin[2]) / d[2];
  return Math.abs(d[2]) > 0.03 && t > 0 ? add(ray.origin, scale(d, t)) : atDepth(ray, depth);
}

// By how many radians the ray is turned around the line through `centre`, from where `place` is.
function turnAround(centre: Point, axis: Point, place: Point, ray: Ray): number {
  const arm = sub(place, centre),
    radius = length(arm),
    d = unit(ray.direction),
    slant = dot(d, axis);
  const tangent = unit(cross(axis, arm));
  if (Math.abs(slant) < 0.15) return Math.atan(alongAxis(place, tangent, ray) / radius);
  const to = sub(add(ray.origin, scale(d, dot(axis, sub(place, ray.origin)) / slant)), centre);
  return Math.atan2(dot(to, tangent), dot(to, unit(arm)));
}

function boxHandles(shape: Box | TurnedBox): Handle[] {
  const straight = 'box' in shape;
  const {min, max} = straight ? shape.box : {min: [0, 0, 0] as Point, max: [0, 0, 0] as Point};
  const {centre, half, angles} = straight
    ? {
        centre: scale(add(min, max), 0.5),
        half: scale(sub(max, min), 0.5),
        angles: [0, 0, 0] as Point,
      }
    : shape.turned_box;
  const axes = straight ? kAxes : axesOf(angles);
  const handles: Handle[] = [
    {
      place: centre,
      colour: kCentreColour,
      name: 'centre',
      drag: (ray, depth) => {
        const move = sub(atDepth(ray, depth), centre);
        return straight
          ? {box: {min: add(min, move), max: add(max, move)}}
          : {turned_box: {centre: add(centre, move), half, angles}};
      },
    },
  ];
  for (let k = 0; k < 3; ++k) {
    const axis = axes[k]!;
    for (const upper of [false, true]) {
      const sign = upper ? 1 : -1,
        place = add(centre, scale(axis, sign * half[k]!));
      if (straight) place[k] = (upper ? max : min)[k]!;
      handles.push({
        place,
        colour: kAxisColours[k]!,
        name: (upper ? 'max' : 'min') + 'xyz'[k],
        drag: ray => {
          const by = alongAxis(place, axis, ray);
          if (straight) {
            const box = {min: [...min] as Point, max: [...max] as Point};
            if (upper) box.max[k] = Math.max(place[k]! + by, min[k]!);
            else box.min[k] = Math.min(place[k]! + by, max[k]!);
            return {box};
          }
          const larger = Math.max((sign * by) / 2, -half[k]!),
            size = [...half] as Point;
          size[k] = half[k]! + larger;
          return {
            turned_box: {centre: add(centre, scale(axis, sign * larger)), half: size, angles},
          };
        },
      });
    }
    // At the middle of an edge that runs along the axis.
    const i = (k + 1) % 3,
      j = (k + 2) % 3,
      edge = add(centre, add(scale(axes[i]!, half[i]!), scale(axes[j]!, half[j]!)));
    if (!(length(sub(edge, centre)) > 0)) continue;
    handles.push({
      place: edge,
      colour: kAxisColours[k]!,
      name: 'turn' + 'xyz'[k],
      turns: axis,
      drag: ray => {
        const by = new three.Quaternion().setFromAxisAngle(
          new three.Vector3(...axis),
          turnAround(centre, axis, edge, ray),
        );
        const now = axes.map(a => new three.Vector3(...a).applyQuaternion(by).toArray()) as [
          Point,
          Point,
          Point,
        ];
        return {turned_box: {centre, half, angles: anglesOf(now)}};
      },
    });
  }
  return handles;
}

function ballHandles({centre, radius}: {centre: Point; radius: number}): Handle[] {
  return [
    {
      place: centre,
      colour: kCentreColour,
      name: 'centre',
      drag: (ray, depth) => ({sphere: {centre: atDepth(ray, depth), radius}}),
    },
    ...kAxes.map((axis, k): Handle => ({
      place: add(centre, scale(axis, radius)),
      colour: kAxisColours[k]!,
      name: 'radius' + 'xyz'[k],
      drag: ray => ({
        sphere: {
          centre,
          radius: Math.max(0, radius + alongAxis(add(centre, scale(axis, radius)), axis, ray)),
        },
      }),
    })),
  ];
}

function planeHandles({point, normal}: {point: Point; normal: Point}, arm: number): Handle[] {
  const n = unit(normal);
  return [
    {
      place: point,
      colour: kCentreColour,
      name: 'centre',
      drag: ray => ({
        half_space: {point: add(point, scale(n, alongAxis(point, n, ray))), normal: n},
      }),
    },
    {
      place: add(point, scale(n, arm)),
      colour: kAxisColours[2]!,
      name: 'normal',
      drag: (ray, depth) => {
        const to = sub(atDepth(ray, depth), point);
        return {half_space: {point, normal: length(to) > 0 ? unit(to) : n}};
      },
    },
  ];
}

// `side`: degrees from the wedge's middle; where its border meets its far end.
function corner({apex, direction, angle, far}: Wedge, side: number): Point {
  const [x, y] = turned(direction, (side * angle) / 2),
    reach = far / Math.max(Math.cos((angle * Math.PI) / 360), 0.05);
  return add(apex, [x * reach, y * reach, 0]);
}

function wedgeHandles(wedge: Wedge, above: number): Handle[] {
  const {apex, direction} = wedge;
  const flat = (p: Point): [number, number] => [p[0] - apex[0], p[1] - apex[1]];
  const far = add(apex, [direction[0] * wedge.far, direction[1] * wedge.far, 0]),
    top = add(apex, [0, 0, above]);
  return [
    {
      place: apex,
      colour: kCentreColour,
      name: 'apex',
      drag: (ray, depth) => ({wedge: {...wedge, apex: onPlane(ray, apex[2], depth)}}),
    },
    {
      place: top,
      colour: kAxisColours[2]!,
      name: 'height',
      drag: ray => ({wedge: {...wedge, apex: add(apex, [0, 0, alongAxis(top, [0, 0, 1], ray)])}}),
    },
    {
      place: far,
      colour: kAxisColours[1]!,
      name: 'far',
      drag: (ray, depth) => {
        const [x, y] = flat(onPlane(ray, apex[2], depth)),
          reach = Math.hypot(x, y);
        return reach > 0
          ? {wedge: {...wedge, direction: [x / reach, y / reach], far: reach}}
          : {wedge};
      },
    },
    ...[-1, 1].map((side): Handle => ({
      place: scale(add(apex, corner(wedge, side)), 0.5),
      colour: kAxisColours[0]!,
      name: side < 0 ? 'right' : 'left',
      drag: (ray, depth) => {
        const [x, y] = flat(onPlane(ray, apex[2], depth));
        const off =
          Math.abs(
            Math.atan2(direction[0] * y - direction[1] * x, direction[0] * x + direction[1] * y),
          ) *
          (180 / Math.PI);
        return {wedge: {...wedge, angle: Math.max(2, Math.min(170, 2 * off))}};
      },
    })),
  ];
}

// A shape's outline, two points a line.
function linesOf(shape: Shape, size: number, lowest: number): Point[] {
  const points: Point[] = [];
  const line = (a: Point, b: Point) => points.push(a, b);
  if ('box' in shape || 'turned_box' in shape) {
    const handles = boxHandles(shape),
      place = (name: string) => handles.find(h => h.name === name)!.place;
    const centre = place('centre'),
      arms = ['maxx', 'maxy', 'maxz'].map(name => sub(place(name), centre));
    const at = (i: number) =>
      arms.reduce((p, arm, k) => add(p, scale(arm, (i >> k) & 1 ? 1 : -1)), centre);
    for (let i = 0; i < 8; ++i)
      for (let k = 0; k < 3; ++k) if (!((i >> k) & 1)) line(at(i), at(i | (1 << k)));
  } else if ('sphere' in shape) {
    const {centre, radius} = shape.sphere;
    for (let k = 0; k < 3; ++k) {
      const at = (i: number) =>
        add(
          centre,
          add(
            scale(kAxes[(k + 1) % 3]!, radius * Math.cos((i * Math.PI) / 36)),
            scale(kAxes[(k + 2) % 3]!, radius * Math.sin((i * Math.PI) / 36)),
          ),
        );
      for (let i = 0; i < 72; ++i) line(at(i), at(i + 1));
    }
  } else if ('wedge' in shape) {
    const {apex} = shape.wedge,
      ends = [-1, 1].map(side => corner(shape.wedge, side)) as [Point, Point];
    const down = (p: Point): Point => [p[0], p[1], Math.min(p[2], lowest)];
    const around = [apex, ends[0], ends[1]];
    around.forEach((p, i) => {
      line(p, around[(i + 1) % 3]!);
      line(p, down(p));
    });
  } else {
    const {point, normal} = shape.half_space;
    const n = unit(normal),
      side = unit(cross(n, Math.abs(n[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0])),
      other = cross(n, side);
    const at = (i: number, j: number) =>
      add(point, add(scale(side, i * size), scale(other, j * size)));
    for (let i = -2; i <= 2; ++i) {
      line(at(i / 2, -1), at(i / 2, 1));
      line(at(-1, i / 2), at(1, i / 2));
    }
    line(point, add(point, scale(n, size * 0.35)));
  }
  return points;
}

export class FocusHandles {
  readonly root = new three.Group();
  shape: Shape | null = null;
  private handles: Handle[] = [];
  private readonly dots: three.Mesh[] = [];
  private readonly lines: three.LineSegments;
  private readonly hidden: three.LineSegments;
  private held: {handle: number; pointer: number; depth: number; grip: [number, number]} | null =
    null; // grip: from the pointer to the handle
  private readonly ball = new three.SphereGeometry(1, 20, 14);
  private readonly ring = new three.TorusGeometry(1.25, 0.36, 10, 28); // around z

  // `changed` is called with each new shape.
  constructor(
    private readonly element: HTMLElement,
    private readonly navigation: Navigation,
    private readonly changed: (shape: Shape) => void,
  ) {
    const geometry = new three.BufferGeometry();
    this.lines = new three.LineSegments(
      geometry,
      new three.LineBasicMaterial({color: kCentreColour}),
    );
    this.hidden = new three.LineSegments(
      geometry,
      new three.LineBasicMaterial({
        color: kCentreColour,
        transparent: true,
        opacity: 0.25,
        depthTest: false,
      }),
    );
    this.lines.frustumCulled = this.hidden.frustumCulled = false;
    this.lines.renderOrder = 3;
    this.hidden.renderOrder = 2;
    this.root.add(this.lines, this.hidden);
    element.addEventListener('pointerdown', e => this.onDown(e), {capture: true});
    element.addEventListener('pointermove', e => this.onMove(e), {capture: true});
    for (const name of ['pointerup', 'pointercancel'] as const)
      element.addEventListener(name, e => this.onUp(e), {capture: true});
  }

  get dragging() {
    return this.held !== null;
  }

  set(shape: Shape | null) {
    this.shape = shape;
    this.root.visible = shape !== null;
    this.handles = shape ? this.handlesOf(shape) : [];
    while (this.dots.length < this.handles.length) {
      const dot = new three.Mesh(
        this.ball,
        new three.MeshBasicMaterial({depthTest: false, transparent: true, opacity: 0.92}),
      );
      dot.renderOrder = 4;
      dot.frustumCulled = false;
      this.dots.push(dot);
      this.root.add(dot);
    }
    this.dots.forEach((dot, i) => (dot.visible = i < this.handles.length));
    if (shape) this.draw(shape);
  }

  // Handles have one size on the screen.
  update() {
    const eye = this.navigation.eye(),
      height = this.element.clientHeight;
    this.handles.forEach((handle, i) => {
      const dot = this.dots[i]!;
      dot.position.copy(this.navigation.toScene(handle.place));
      const size = unitsPerPixel(
        {eye, target: eye, fov: this.navigation.camera.fov, viewport: [1, height]},
        length(sub(handle.place, eye)),
      );
      dot.scale.setScalar(size * (this.held?.handle === i ? 9 : 7));
      dot.geometry = handle.turns ? this.ring : this.ball;
      if (handle.turns)
        dot.quaternion.setFromUnitVectors(
          new three.Vector3(0, 0, 1),
          new three.Vector3(...handle.turns),
        );
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
    return [
      ((p.x + 1) / 2) * this.element.clientWidth,
      ((1 - p.y) / 2) * this.element.clientHeight,
    ];
  }

  private handlesOf(shape: Shape): Handle[] {
    if ('box' in shape || 'turned_box' in shape) return boxHandles(shape);
    if ('sphere' in shape) return ballHandles(shape.sphere);
    if ('wedge' in shape) return wedgeHandles(shape.wedge, this.navigation.radius() * 0.06);
    return planeHandles(shape.half_space, this.navigation.radius() * 0.35);
  }

  private draw(shape: Shape) {
    const lines = linesOf(shape, this.navigation.radius(), this.navigation.lowest());
    const array = new Float32Array(lines.flatMap(p => this.navigation.toScene(p).toArray()));
    this.lines.geometry.setAttribute('position', new three.BufferAttribute(array, 3));
  }

  private atPointer(event: PointerEvent) {
    const box = this.element.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top] as const;
  }

  private onDown(event: PointerEvent) {
    if (!this.shape || event.button !== 0 || this.held) return;
    const [x, y] = this.atPointer(event);
    let best = event.pointerType === 'touch' ? 26 : 14,
      found = -1;
    this.handles.forEach((handle, i) => {
      const p = this.onScreen(handle.place);
      const distance = p ? Math.hypot(p[0] - x, p[1] - y) : Infinity;
      if (distance < best) [best, found] = [distance, i];
    });
    if (found < 0) return;
    const forward = this.navigation.camera
      .getWorldDirection(new three.Vector3())
      .toArray() as Point;
    const at = this.onScreen(this.handles[found]!.place)!;
    this.held = {
      handle: found,
      pointer: event.pointerId,
      depth: dot(sub(this.handles[found]!.place, this.navigation.eye()), forward),
      grip: [at[0] - x, at[1] - y],
    };
    this.element.setPointerCapture(event.pointerId);
    event.stopImmediatePropagation();
    event.preventDefault();
  }

  private onMove(event: PointerEvent) {
    if (!this.held || event.pointerId !== this.held.pointer) return;
    event.stopImmediatePropagation();
    const [x, y] = this.atPointer(event),
      [dx, dy] = this.held.grip;
    const shape = this.handles[this.held.handle]!.drag(
      this.navigation.ray(x + dx, y + dy),
      this.held.depth,
    );
    this.set(shape);
    this.changed(shape);
  }

  private onUp(event: PointerEvent) {
    if (!this.held || event.pointerId !== this.held.pointer) return;
    event.stopImmediatePropagation();
    this.held = null;
  }
}
