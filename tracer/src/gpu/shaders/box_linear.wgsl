// Few boxes: each ray meets each of them.

// Bit i is set if the ray may meet box `first + i` before `t_max`.
fn box_candidates(prepared: PreparedRay, first: u32, t_max: f32) -> u32 {
    var candidates = 0u;
    for (var i = 0u; i < min(BOX_COUNT - first, 32u); i++) {
        let may_meet = may_meet_box(prepared, scene.box_bounds[first + i], t_max);
        candidates |= select(0u, 1u << i, may_meet);
    }
    return candidates;
}

fn nearest_box(prepared: PreparedRay, start: u32, hit: ptr<function, Hit>) {
    let own = own_box(prepared, start, hit);
    for (var first = 0u; first < BOX_COUNT; first += 32u) {
        var candidates = box_candidates(prepared, first, (*hit).t);
        while (candidates != 0u) {
            let i = first + firstTrailingBit(candidates);
            candidates &= candidates - 1u;
            let t = box_t(prepared, i);
            if (t < (*hit).t && BOX_FIRST + i != own) {
                *hit = Hit(t, BOX_FIRST + i);
            }
        }
    }
}
