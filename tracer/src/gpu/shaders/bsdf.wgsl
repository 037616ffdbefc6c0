// Definitions shared by all materials. Both directions point away from the surface, with `wo` on
// the normal's side.

// `weight` is f · |cos θi| / pdf. `pdf` is per solid angle; it is `SPECULAR` for a delta
// distribution, and 0 for the mirror of a coat, whose area lights `coat_reflected_light` has
// already accounted for.
struct BsdfSample {
    wi: vec3f,
    weight: vec3f,
    pdf: f32,
}

// BSDF value, and the density with which the direction is sampled.
struct Evaluated {
    f: vec3f,
    pdf: f32,
}

// In place of a density, marks a direction that next-event estimation cannot find, so that its
// light counts in full.
const SPECULAR: f32 = -1.0;
// The same for a path that was scattered inside a body.
const SCATTERED: f32 = -2.0;
