// Linear search over few boxes, by groups of 32 with a conservative test first.

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
