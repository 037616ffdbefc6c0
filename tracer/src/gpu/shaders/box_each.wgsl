// Few boxes: each ray meets each of them.

// Bit i is set if the ray may meet box `first + i` before `t_max`: three products of each slab are
// the ray's own, which rounds worse, so that the bounds are a little wider than the boxes.
fn box_candidates(line: Line, first: u32, t_max: f32) -> u32 {
    var candidates = 0u;
    for (var i = 0u; i < min(BOX_COUNT - first, 32u); i++) {
        let bound = scene.box_bounds[first + i];
        let middle = fma(bound.center, line.inverse, -line.origin_inverse);
        let enter = largest(fma(-bound.half, line.inverse_abs, middle));
        let leave = smallest(fma(bound.half, line.inverse_abs, middle));
        candidates |= select(0u, 1u << i, max(enter, 0.0) <= min(leave, t_max));
    }
    return candidates;
}

fn nearest_box(line: Line, skip: u32, hit: ptr<function, Hit>) {
    let own = own_box(line, skip, hit);
    for (var first = 0u; first < BOX_COUNT; first += 32u) {
        var candidates = box_candidates(line, first, (*hit).t);
        while (candidates != 0u) {
            let i = first + firstTrailingBit(candidates);
            candidates &= candidates - 1u;
            let t = box_t(line, i);
            if (t < (*hit).t && BOX_FIRST + i != own) {
                *hit = Hit(t, BOX_FIRST + i);
            }
        }
    }
}

fn box_occludes(line: Line, skip: u32, t_max: f32) -> bool {
    for (var first = 0u; first < BOX_COUNT; first += 32u) {
        var candidates = box_candidates(line, first, t_max);
        while (candidates != 0u) {
            let i = first + firstTrailingBit(candidates);
            candidates &= candidates - 1u;
            if (box_t(line, i) < t_max && BOX_FIRST + i != skip) {
                return true;
            }
        }
    }
    return false;
}
