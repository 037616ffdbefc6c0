// What the materials share. Both directions leave the surface, `wo` on the normal's side.

// `weight` is f · |cos θi| / pdf; `pdf` is per solid angle, `SPECULAR` where there is none.
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

// Stands for the density of a direction that next-event estimation cannot find.
const SPECULAR: f32 = -1.0;
