// What the materials share. Both directions leave the surface, `wo` on the normal's side.

// `weight` is f · |cos θi| / pdf; `pdf` is per solid angle, `SPECULAR` where there is none, 0
// for a coat's mirror, whose area lights `coat_reflected_light` has looked up.
struct BsdfSample {
    wi: vec3f,
    weight: vec3f,
    pdf: f32,
}

// `f`, and the density of a direction.
struct Evaluated {
    f: vec3f,
    pdf: f32,
}

// Stands for the density of a direction that next-event estimation cannot find, so that light along
// it counts in full.
const SPECULAR: f32 = -1.0;
// The same of a path that was scattered inside a body.
const SCATTERED: f32 = -2.0;
