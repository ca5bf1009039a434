// SPDX-License-Identifier: Apache-2.0
// How the camera moves: around a point, or flying; home, side views, going there. In the page's
// coordinates.
import CameraControls from 'camera-controls';
import * as three from 'three';
import {add, cross, dot, length, scale, sub, unit, type Camera, type Point} from './query';
import {basisOf, inBasis, kZUp, type Basis} from './up';

CameraControls.install({
  THREE: {
    Vector2: three.Vector2,
    Vector3: three.Vector3,
    Vector4: three.Vector4,
    Quaternion: three.Quaternion,
    Matrix4: three.Matrix4,
    Spherical: three.Spherical,
    Box3: three.Box3,
    Sphere: three.Sphere,
    Raycaster: three.Raycaster,
  },
});

export interface Bounds {
  min: Point;
  max: Point;
}

// Where the camera is, as steps to the right, to where the front's viewer looks, and up; home is
// homeView().
export const views: Record<string, Point> = {
  front: [0, -1, 0],
  back: [0, 1, 0],
  left: [-1, 0, 0],
  right: [1, 0, 0],
  top: [0, -1e-4, 1],
  bottom: [0, -1e-4, -1],
};

const kFlyKeys: Record<string, Point> = {
  // right, up, forward
  KeyW: [0, 0, 1],
  KeyS: [0, 0, -1],
  KeyA: [-1, 0, 0],
  KeyD: [1, 0, 0],
  KeyE: [0, 1, 0],
  KeyQ: [0, -1, 0],
};
const kBroader = 1.75; // as tools/render/view.cc has them
const kFlat = 0.3;
const kMargin = 1.06; // of a view, beside the shape
const kTurnKeys: Record<string, [number, number]> = {
  ArrowLeft: [1, 0],
  ArrowRight: [-1, 0],
  ArrowUp: [0, 1],
  ArrowDown: [0, -1],
};

export class Navigation {
  readonly camera = new three.PerspectiveCamera(45, 1, 0.1, 1000);
  readonly controls: CameraControls;
  flying = false;
  speed = 1; // of flying, as a factor
  onSpeed: (speed: number) => void = () => {};
  // What a view is to have in the picture; else the bounds.
  shape: () => Float64Array | null = () => null;
  private basis: Basis = basisOf(kZUp);
  private frame: Point = [0, 0, 0];
  private bounds: Bounds = {min: [-1, -1, -1], max: [1, 1, 1]};
  private readonly pressed = new Set<string>();
  private readonly smooth = !matchMedia('(prefers-reduced-motion: reduce)').matches;
  private look: {id: number; x: number; y: number} | null = null;

  // `surfaceAt` finds the surface under a place of the picture; moving goes by it.
  constructor(
    private readonly element: HTMLElement,
    private readonly surfaceAt: (x: number, y: number) => Promise<Point | null>,
  ) {
    this.camera.up.set(0, 0, 1);
    this.controls = new CameraControls(this.camera, element);
    this.controls.dollyToCursor = true; // of fingers; the wheel is ours
    this.controls.mouseButtons.wheel = CameraControls.ACTION.NONE;
    this.controls.smoothTime = this.smooth ? 0.12 : 0.001;
    this.controls.draggingSmoothTime = 0.05;
    this.controls.mouseButtons.middle = CameraControls.ACTION.TRUCK;
    this.controls.touches.two = CameraControls.ACTION.TOUCH_DOLLY_TRUCK;
    this.controls.touches.three = CameraControls.ACTION.TOUCH_TRUCK;
    this.controls.minPolarAngle = 0.0005;
    this.controls.maxPolarAngle = Math.PI - 0.0005;
    this.listen();
  }

  // The scene's origin and what is in it.
  place(frame: Point, bounds: Bounds) {
    this.frame = frame;
    this.bounds = bounds;
    const size = this.radius();
    this.controls.minDistance = size * 1e-5;
    this.controls.maxDistance = size * 50;
  }

  get up(): Point {
    return this.basis.up;
  }

  // One turns around it.
  setUp(up: Point) {
    this.basis = basisOf(up);
    this.camera.up.set(...this.basis.up);
    this.controls.updateCameraUp();
  }

  // A direction of (right, front, up).
  direction(of: Point): Point {
    return inBasis(this.basis, of);
  }

  radius() {
    return Math.max(length(sub(this.bounds.max, this.bounds.min)) / 2, 1e-9);
  }

  lowest() {
    return this.bounds.min[2];
  }

  toScene(p: Point) {
    return new three.Vector3(...sub(p, this.frame));
  }

  eye(): Point {
    return add(this.frame, this.camera.position.toArray() as Point);
  }

  target(): Point {
    return add(this.frame, this.controls.getTarget(new three.Vector3(), false).toArray() as Point);
  }

  // The distance at which errors and the scale bar are told.
  depth() {
    return Math.max(length(sub(this.target(), this.eye())), 1e-12);
  }

  query(viewport: [number, number]): Camera {
    const eye = this.eye();
    const forward = this.camera.getWorldDirection(new three.Vector3()).toArray() as Point;
    const up = dot(this.up, kZUp) > 1 - 1e-12 ? {} : {up: this.up};
    return {
      eye,
      target: add(eye, scale(forward, this.depth())),
      ...up,
      fov: this.camera.fov,
      viewport,
    };
  }

  // The ray through a place of the element, in CSS pixels. Its direction has the length that leads
  // to a depth of 1.
  ray(x: number, y: number): {origin: Point; direction: Point} {
    const forward = this.camera.getWorldDirection(new three.Vector3()).toArray() as Point;
    const right = unit(cross(forward, this.up));
    const up = cross(right, forward);
    const tan = Math.tan((this.camera.fov * Math.PI) / 360);
    const w = this.element.clientWidth,
      h = this.element.clientHeight;
    const px = ((2 * x) / w - 1) * tan * (w / h),
      py = (1 - (2 * y) / h) * tan;
    return {origin: this.eye(), direction: add(forward, add(scale(right, px), scale(up, py)))};
  }

  set(eye: Point, target: Point, moves = true) {
    const e = this.toScene(eye),
      t = this.toScene(target);
    void this.controls.setLookAt(e.x, e.y, e.z, t.x, t.y, t.z, moves && this.smooth);
  }

  view(name: string, moves = true) {
    this.set(...this.framing(unit(this.direction(views[name] ?? this.homeView()))), moves);
  }

  // From the front and the right, as `mtdb render` looks by itself: more from the right where that
  // side is much the broader one, and from higher above where all is flat.
  private homeView(): Point {
    const size = sub(this.bounds.max, this.bounds.min);
    const extent = (of: Point) => dot(of.map(Math.abs) as Point, size);
    const width = extent(this.basis.right),
      depth = extent(this.basis.front),
      broad = depth > kBroader * width;
    const flat = extent(this.basis.up) < kFlat * (broad ? depth : width);
    return [broad ? 0.86 : 0.42, broad ? -0.42 : -0.86, flat ? 0.8 : 0.34];
  }

  // Eye and target, seen from `direction`, so near that the shape just fits the picture.
  private framing(direction: Point): [Point, Point] {
    const centre = scale(add(this.bounds.min, this.bounds.max), 0.5);
    const right = unit(cross(scale(direction, -1), this.up)),
      up = cross(right, scale(direction, -1));
    const tan = Math.tan((this.camera.fov * Math.PI) / 360),
      wide = tan * this.camera.aspect;
    const shape =
      this.shape() ??
      Float64Array.from(
        Array.from({length: 24}, (_, i) =>
          ((i / 3) >> (i % 3)) & 1 ? this.bounds.max[i % 3]! : this.bounds.min[i % 3]!,
        ),
      );
    // For each side of the picture, by how much points reach beyond its plane when the eye is at
    // the centre.
    let nearest = 0,
      a = -Infinity,
      b = -Infinity,
      c = -Infinity,
      d = -Infinity;
    for (let i = 0; i + 2 < shape.length; i += 3) {
      const p: Point = [
        shape[i]! - centre[0],
        shape[i + 1]! - centre[1],
        shape[i + 2]! - centre[2],
      ];
      const x = dot(p, right),
        y = dot(p, up),
        near = dot(p, direction);
      nearest = Math.max(nearest, near);
      a = Math.max(a, x + wide * near);
      b = Math.max(b, wide * near - x);
      c = Math.max(c, y + tan * near);
      d = Math.max(d, tan * near - y);
    }
    const distance = Math.max(
      nearest + 0.3 * this.radius(),
      kMargin * Math.max((a + b) / (2 * wide), (c + d) / (2 * tan)),
    );
    // What is far takes less of the picture than what is near: where there is room, the middle is
    // that of the picture.
    let across = (a - b) / 2,
      along = (c - d) / 2;
    for (let turn = 0; turn < 8; ++turn) {
      let left = Infinity,
        most = -Infinity,
        low = Infinity,
        high = -Infinity;
      for (let i = 0; i + 2 < shape.length; i += 3) {
        const p: Point = [
            shape[i]! - centre[0],
            shape[i + 1]! - centre[1],
            shape[i + 2]! - centre[2],
          ],
          depth = distance - dot(p, direction);
        const x = (dot(p, right) - across) / depth,
          y = (dot(p, up) - along) / depth;
        left = Math.min(left, x);
        most = Math.max(most, x);
        low = Math.min(low, y);
        high = Math.max(high, y);
      }
      across += (distance * (left + most)) / 2;
      along += (distance * (low + high)) / 2;
    }
    const target = add(centre, add(scale(right, across), scale(up, along)));
    return [add(target, scale(direction, distance)), target];
  }

  // Towards a point of the surface, until it is a third as far.
  goTo(point: Point) {
    const way = sub(this.eye(), point);
    this.set(add(point, scale(way, 0.35)), point);
  }

  fly(on: boolean) {
    this.flying = on;
    this.pressed.clear();
    const {ROTATE, NONE, TRUCK} = CameraControls.ACTION;
    this.controls.mouseButtons.left = on ? NONE : ROTATE;
    this.controls.mouseButtons.right = on ? NONE : TRUCK;
    this.controls.touches.one = on ? NONE : CameraControls.ACTION.TOUCH_ROTATE;
  }

  private hasten(factor: number) {
    this.speed = Math.max(0.02, Math.min(50, this.speed * factor));
    this.onSpeed(this.speed);
  }

  // Whether it moves still.
  update(seconds: number): boolean {
    this.flyOn(seconds);
    const moves = this.controls.update(seconds);
    this.setPlanes();
    return moves || this.pressed.size > 0;
  }

  // Near and far, as tight as what is in the scene allows: depth has few bits.
  private setPlanes() {
    const centre = scale(add(this.bounds.min, this.bounds.max), 0.5);
    const distance = length(sub(this.eye(), centre)),
      radius = this.radius() * 1.01;
    const far = distance + radius;
    this.camera.near = Math.max(
      distance - radius,
      Math.min(this.depth() * 0.02, far * 0.01),
      far * 1e-6,
    );
    this.camera.far = Math.max(far, this.camera.near * 2);
    this.camera.updateProjectionMatrix();
  }

  private flyOn(seconds: number) {
    if (this.pressed.size === 0) return;
    let move: Point = [0, 0, 0],
      turn: [number, number] = [0, 0];
    for (const key of this.pressed) {
      if (this.flying && kFlyKeys[key]) move = add(move, kFlyKeys[key]!);
      const way = kTurnKeys[key];
      if (way) turn = [turn[0] + way[0], turn[1] + way[1]];
    }
    if (turn[0] || turn[1]) {
      if (this.flying) this.turn(turn[0] * seconds * 1.2, turn[1] * seconds * 1.2);
      else if (this.pressed.has('Shift'))
        void this.controls.truck(
          -turn[0] * seconds * this.depth() * 0.8,
          -turn[1] * seconds * this.depth() * 0.8,
          false,
        );
      else void this.controls.rotate(turn[0] * seconds * 1.6, -turn[1] * seconds * 1.6, false);
    }
    if (!this.flying) return;
    const step =
      seconds *
      this.speed *
      Math.max(this.depth(), this.radius() * 0.002) *
      (this.pressed.has('Shift') ? 3 : 0.8);
    const forward = this.camera.getWorldDirection(new three.Vector3()).toArray() as Point;
    const right = unit(cross(forward, this.up));
    const way = add(
      add(scale(right, move[0] * step), scale(this.up, move[1] * step)),
      scale(forward, move[2] * step),
    );
    if (length(way) > 0) this.set(add(this.eye(), way), add(this.target(), way), false);
  }

  // Looks elsewhere from where the camera is; radians, to the left and up.
  private turn(left: number, up: number) {
    const eye = this.eye(),
      forward = unit(sub(this.target(), eye));
    const azimuth =
      Math.atan2(dot(forward, this.basis.front), dot(forward, this.basis.right)) + left;
    const height = Math.max(
      -1.55,
      Math.min(1.55, Math.asin(Math.max(-1, Math.min(1, dot(forward, this.up)))) + up),
    );
    const to = this.direction([
      Math.cos(azimuth) * Math.cos(height),
      Math.sin(azimuth) * Math.cos(height),
      Math.sin(height),
    ]);
    this.set(eye, add(eye, scale(to, this.depth())), false);
  }

  private listen() {
    this.element.addEventListener('pointerdown', event => {
      if (this.flying && this.controls.enabled)
        this.look = {id: event.pointerId, x: event.clientX, y: event.clientY};
    });
    this.element.addEventListener('pointermove', event => {
      if (!this.look || event.pointerId !== this.look.id) return;
      const radians = (this.camera.fov * Math.PI) / 180 / this.element.clientHeight;
      this.turn((event.clientX - this.look.x) * radians, (event.clientY - this.look.y) * radians);
      this.look = {id: event.pointerId, x: event.clientX, y: event.clientY};
    });
    for (const name of ['pointerup', 'pointercancel'] as const)
      addEventListener(name, () => (this.look = null));
    this.listenToWheel();
    const onPage = (event: KeyboardEvent) =>
      !(event.target as HTMLElement).closest?.('input, select, textarea');
    addEventListener('keydown', event => {
      if (!onPage(event) || event.ctrlKey || event.metaKey || event.altKey) return;
      if (kTurnKeys[event.code] || (this.flying && kFlyKeys[event.code])) {
        this.pressed.add(event.code);
        event.preventDefault();
      } else if (event.key === 'Shift') {
        this.pressed.add('Shift');
      } else if (event.key === '+' || event.key === '-') {
        if (this.flying) this.hasten(event.key === '+' ? 1.25 : 0.8);
        else
          void this.controls.dolly(this.depth() * (event.key === '+' ? 0.2 : -0.25), this.smooth);
      }
    });
    addEventListener('keyup', event => {
      this.pressed.delete(event.code);
      if (event.key === 'Shift') this.pressed.delete('Shift');
    });
    addEventListener('blur', () => this.pressed.clear());
  }

  // The wheel zooms towards the surface under the cursor, which stays where it is in the picture.
  private listenToWheel() {
    let last = {time: -Infinity, x: 0, y: 0},
      gesture = 0,
      pixels = 0;
    let towards: Point | null = null;
    this.element.addEventListener(
      'wheel',
      event => {
        if (!this.controls.enabled) return;
        event.preventDefault();
        const scrolled = event.deltaY * [1, 16, 400][event.deltaMode]!;
        if (this.flying)
          return this.hasten(Math.exp(-0.0016 * Math.max(-400, Math.min(400, scrolled))));
        pixels += Math.max(-400, Math.min(400, scrolled));
        const begins =
          event.timeStamp - last.time > 400 ||
          Math.hypot(event.clientX - last.x, event.clientY - last.y) > 4;
        last = {time: event.timeStamp, x: event.clientX, y: event.clientY};
        const zoom = () => {
          if (towards) this.zoom(towards, Math.exp(0.0016 * pixels));
          pixels = 0;
        };
        if (!begins) return void (towards && zoom());
        towards = null;
        const mine = ++gesture;
        const box = this.element.getBoundingClientRect();
        const x = event.clientX - box.left,
          y = event.clientY - box.top;
        const {origin, direction} = this.ray(x, y);
        void this.surfaceAt(x, y).then(hit => {
          if (mine !== gesture) return;
          towards = hit ?? add(origin, scale(direction, this.depth()));
          zoom();
        });
      },
      {passive: false},
    );
  }

  // Everything comes so many times nearer to `point`, which becomes the depth that one turns
  // around.
  private zoom(point: Point, factor: number) {
    const eye = add(
      this.frame,
      this.controls.getPosition(new three.Vector3(), true).toArray() as Point,
    );
    const end = add(
      this.frame,
      this.controls.getTarget(new three.Vector3(), true).toArray() as Point,
    );
    const forward = unit(sub(end, eye));
    const depth = dot(sub(point, eye), forward);
    if (!(depth > 0)) return;
    const target = add(eye, scale(forward, depth));
    const f = Math.max(
      this.controls.minDistance / depth,
      Math.min(this.controls.maxDistance / depth, factor),
    );
    const nearer = (p: Point) => add(point, scale(sub(p, point), f));
    this.set(nearer(eye), nearer(target));
  }
}
