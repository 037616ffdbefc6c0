// The table of those surfaces that emit which lie beside the scene's own data.

// The last that does not begin above `u`. As many steps as halve the most that there may be.
fn emissive_shape(u: f32) -> EmissiveSurfaceData {
    var first = 0u;
    var last = EMISSIVE_SHAPE_COUNT;
    for (var step = 0u; step < 21u && last - first > 1u; step++) {
        let middle = (first + last) / 2u;
        if (scene_storage.emissive_shapes[middle].before <= u) {
            first = middle;
        } else {
            last = middle;
        }
    }
    return scene_storage.emissive_shapes[first];
}
