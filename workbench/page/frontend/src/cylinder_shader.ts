/** How the wall is coloured: the texture in the panes' colours, light, the part cut away, and the marks. */

export const VERTEX = `
attribute vec2 place;
varying vec2 spot; // θ in turns, z in mm
varying vec3 eye;
varying vec3 outward;
void main() {
  spot = place;
  vec4 seen = modelViewMatrix * vec4(position, 1.0);
  eye = seen.xyz;
  outward = normalMatrix * normal;
  gl_Position = projectionMatrix * seen;
}
`;

export const FRAGMENT = `
precision highp float;
uniform sampler2D layer;   // a code and its opacity, or a colour, premultiplied
uniform sampler2D colours; // of the 256 codes
uniform bool coded;
uniform sampler2D outlines; // premultiplied, of the whole wall
uniform bool outlined;
uniform vec2 extent;       // z of the first row of the texture, and how long it is, mm
uniform vec2 wall;         // z of the wall's top and bottom, mm
uniform float circumference;
uniform vec2 cut;          // the middle of the part cut away, and half its width, in turns
uniform vec2 range;        // from where to where along z it is shown, mm
uniform vec3 cursor;       // θ in turns, z in mm, and whether there is one
uniform vec3 pinned;
uniform float pixels;      // of the screen for one of the page's
uniform float light;
uniform bool picking;
uniform bool bare;         // nothing but marks: the volume is shown in place of the wall
varying vec2 spot;
varying vec3 eye;
varying vec3 outward;

float around(float turns) { return turns - floor(turns + 0.5); }

/** A cross at a place, as in the panes: how much of its edge and of its middle covers this pixel. */
vec2 cross_(vec3 place, vec2 fineness) {
  if (place.z < 0.5) return vec2(0.0);
  vec2 apart = abs(vec2(around(spot.x - place.x) * circumference, spot.y - place.y)) / fineness / pixels;
  float across = min(apart.x, apart.y);
  float along = max(apart.x, apart.y);
  float arm = step(4.0, along) * step(along, 14.0);
  return arm * vec2(1.0 - smoothstep(1.5, 2.2, across), 1.0 - smoothstep(0.4, 1.1, across));
}

void main() {
  if (abs(around(spot.x - cut.x)) < cut.y || spot.y < range.x || spot.y > range.y) discard;
  // before anything else is left out: slopes are of neighbouring pixels
  vec2 fineness = max(fwidth(vec2(spot.x * circumference, spot.y)), vec2(1e-6));
  vec4 found = texture2D(layer, vec2(spot.x, (spot.y - extent.x) / extent.y));
  if (found.a < 0.5) discard;
  if (picking) {
    float turn = floor(fract(spot.x) * 65535.0 + 0.5);
    float z = 1.0 + floor(clamp((spot.y - wall.x) / (wall.y - wall.x), 0.0, 1.0) * 65534.0 + 0.5);
    gl_FragColor = vec4(floor(turn / 256.0), mod(turn, 256.0), floor(z / 256.0), mod(z, 256.0)) / 255.0;
    return;
  }
  vec2 of_pinned = cross_(pinned, fineness);
  vec2 of_cursor = cross_(cursor, fineness);
  if (bare && max(of_pinned.x, of_cursor.x) < 0.5) discard;
  vec3 colour = found.rgb / found.a;
  if (coded) colour = texture2D(colours, vec2((colour.r * 255.0 + 0.5) / 256.0, 0.5)).rgb;
  if (outlined) {
    vec4 line = texture2D(outlines, vec2(spot.x, (spot.y - wall.x) / (wall.y - wall.x)));
    colour = colour * (1.0 - line.a) + line.rgb;
  }
  float facing = dot(normalize(outward), normalize(-eye));
  float shade = mix(1.0, 0.35 + 0.65 * abs(facing), light);
  // from outside, through the bone: paler, so that nobody takes it for the wall seen from within
  if (!gl_FrontFacing) colour = mix(vec3(dot(colour, vec3(0.3, 0.6, 0.1))), colour, 0.35) * 0.55;
  colour *= shade;
  colour = mix(mix(colour, vec3(0.84, 0.0, 0.48), of_pinned.x), vec3(1.0), of_pinned.y);
  colour = mix(mix(colour, vec3(0.0), 0.75 * of_cursor.x), vec3(1.0), of_cursor.y);
  gl_FragColor = vec4(colour, 1.0);
}
`;
