// Grips and velocities in pixels of the picture, x right and y down. A condition has them in widths and heights.

const SNAP = 15;

export function toPixels(four, size) {
  return [[four[0] * size[0], four[1] * size[1]], [four[2] * size[0], four[3] * size[1]]];
}

export function toFractions(two, size) {
  return two.flatMap(([x, y]) => [x / size[0], y / size[1]]);
}

export function middle([a, b]) {
  return [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
}

export function distance(a, b) {
  return Math.hypot(b[0] - a[0], b[1] - a[1]);
}

// Direction from the first grip to the second, counter-clockwise from image right [degrees].
export function angle([a, b]) {
  return (Math.atan2(a[1] - b[1], b[0] - a[0]) * 180) / Math.PI + 0; // no minus zero
}

export function along(degrees, length) {
  const turn = (degrees * Math.PI) / 180;
  return [length * Math.cos(turn), -length * Math.sin(turn)];
}

// Both grips `half` px from `centre`, on an axis of `degrees`.
export function mirrored(centre, degrees, half) {
  const [x, y] = along(degrees, half);
  return [[centre[0] - x, centre[1] - y], [centre[0] + x, centre[1] + y]];
}

// Where both grips are when grip `which` is at `point`: the other one mirrored about `centre`, or where it was
// (centre null). With `snap` the axis turns to the nearest multiple of 15 degrees, and the length is that along it.
export function dragged(grips, which, point, centre, snap) {
  const from = centre ?? grips[1 - which];
  let [x, y] = [point[0] - from[0], point[1] - from[1]];
  if (snap) {
    const degrees = Math.round(angle([[0, 0], [x, y]]) / SNAP) * SNAP;
    const [ux, uy] = along(degrees, 1);
    const length = x * ux + y * uy;
    [x, y] = [ux * length, uy * length];
  }
  const moved = [from[0] + x, from[1] + y];
  const other = centre ? [from[0] - x, from[1] - y] : grips[1 - which];
  return which === 0 ? [moved, other] : [other, moved];
}

// Velocities of grips that part at `speed` each.
export function parting(grips, speed) {
  const [x, y] = along(angle(grips), speed);
  return [[-x, -y], [x, y]];
}

export function speed([a, b]) {
  return (Math.hypot(...a) + Math.hypot(...b)) / 2;
}
