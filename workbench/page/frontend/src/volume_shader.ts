/** Rays through the dense volume: light that samples above a limit give off and hold back. */

export const VOLUME_VERTEX = `
out vec3 place; // in the bore frame, mm
void main() {
  place = position;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}
`;

export const VOLUME_FRAGMENT = `
precision highp float;
precision highp sampler3D;
uniform sampler3D volume;  // along the radius, around the circle, along z
uniform sampler2D colours; // of the 256 codes
uniform vec3 eye;          // in the bore frame, mm
uniform vec3 counts;       // of samples, columns, slices
uniform vec2 radii;        // of the first and the last sample, mm
uniform vec2 depths;       // z of the first and the last slice, mm
uniform float first;       // θ of the first column, in turns
uniform vec2 cut;          // the middle of the part cut away, and half its width, in turns
uniform vec2 range;        // from where to where along z it is shown, mm
uniform float limit;       // codes below it are not seen, 0 to 1
uniform float light;
uniform int steps;
in vec3 place;
out vec4 shown;

float at(vec3 p) {
  float turn = atan(p.y, p.x) / 6.283185307;
  vec2 share = vec2(length(p.xy) - radii.x, p.z - depths.x) / vec2(radii.y - radii.x, depths.y - depths.x);
  // from the centre of the first sample to that of the last one
  vec2 texel = (share * (counts.xz - 1.0) + 0.5) / counts.xz;
  return texture(volume, vec3(texel.x, turn - first + 0.5 / counts.y, texel.y)).r;
}

/** From where to where a ray is within a cylinder about the axis; nowhere: the first is the larger one. */
vec2 within(vec3 along, float radius) {
  float a = dot(along.xy, along.xy);
  float b = dot(along.xy, eye.xy);
  float c = dot(eye.xy, eye.xy) - radius * radius;
  float d = b * b - a * c;
  if (d < 0.0 || a < 1e-12) return c < 0.0 ? vec2(-1e9, 1e9) : vec2(1.0, 0.0);
  return (vec2(-1.0, 1.0) * sqrt(d) - b) / a;
}

void main() {
  vec3 along = normalize(place - eye);
  vec2 part = within(along, radii.y);
  vec2 slab = (vec2(max(range.x, depths.x), min(range.y, depths.y)) - eye.z) / (abs(along.z) < 1e-6 ? 1e-6 : along.z);
  float start = max(max(part.x, min(slab.x, slab.y)), 0.0);
  float stop = min(part.y, max(slab.x, slab.y));
  if (stop <= start) discard;
  float far = stop - start;
  float size = min(far, 4.0 * radii.y) / float(steps);
  float noise = fract(sin(dot(gl_FragCoord.xy, vec2(12.9898, 78.233))) * 43758.5453);
  float pitch = (radii.y - radii.x) / (counts.x - 1.0);
  vec4 sum = vec4(0.0);
  for (int k = 0; k < 4 * steps; k += 1) {
    float t = start + (float(k) + noise) * size;
    if (t > stop || sum.a > 0.98) break;
    vec3 p = eye + along * t;
    float r = length(p.xy);
    if (r < radii.x || r > radii.y) continue;
    float turn = atan(p.y, p.x) / 6.283185307 - cut.x;
    if (abs(turn - floor(turn + 0.5)) < cut.y) continue;
    float code = at(p);
    float seen = smoothstep(limit, min(limit + 0.25, 1.0), code);
    if (seen < 0.01) continue;
    float opacity = 1.0 - pow(1.0 - 0.35 * seen, size / pitch);
    vec3 colour = texture(colours, vec2((code * 255.0 + 0.5) / 256.0, 0.5)).rgb;
    if (light > 0.5) {
      vec3 slope = vec3(at(p + vec3(2.0 * pitch, 0, 0)), at(p + vec3(0, 2.0 * pitch, 0)), at(p + vec3(0, 0, 2.0 * pitch))) - code;
      float steep = length(slope);
      colour *= mix(1.0, 0.4 + 0.6 * abs(dot(slope, along)) / max(steep, 1e-5), clamp(6.0 * steep, 0.0, 1.0));
    }
    sum += (1.0 - sum.a) * opacity * vec4(colour, 1.0);
  }
  if (sum.a < 0.01) discard;
  shown = sum; // premultiplied
}
`;
