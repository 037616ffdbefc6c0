// Mapping of blocks of 8 × 8 threads to pixels of the job's tiles; `job` holds the number of
// blocks.

@group(0) @binding(2) var<storage, read> tiles: array<TileEntry>;

// A pixel of the image, its index among the pixels of all tiles, and its tile.
struct Place {
    x: u32,
    y: u32,
    pixel: u32,
    tile: u32,
    // Blocks may extend beyond their tile.
    is_inside: bool,
}

fn place_of(block: u32, local: u32) -> Place {
    let index = tile_of_block(block);
    let tile = tiles[index];
    let columns = (tile.width + BLOCK_EDGE - 1u) / BLOCK_EDGE;
    let place = block - tile.first_block;
    let x = (place % columns) * BLOCK_EDGE + local % BLOCK_EDGE;
    let y = (place / columns) * BLOCK_EDGE + local / BLOCK_EDGE;
    let pixel = tile.first_pixel + y * tile.width + x;
    return Place(tile.x + x, tile.y + y, pixel, index, x < tile.width && y < tile.height);
}

// Binary search for the last tile that begins at or before `block`.
fn tile_of_block(block: u32) -> u32 {
    var low = 0u;
    var high = job.tile_count;
    while (high - low > 1u) {
        let middle = (low + high) / 2u;
        if (tiles[middle].first_block <= block) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}

const BLOCK_PIXELS: u32 = BLOCK_EDGE * BLOCK_EDGE;

// The values of a workgroup's pixels before they are written to the film.
var<workgroup> block_film: array<f32, 3u * BLOCK_PIXELS * WORKGROUP_BLOCKS>;

// Writes one value per thread to the film such that adjacent threads write adjacent addresses. A
// film in host memory receives each isolated write as a transaction of its own: 5 ms more for
// 1280x720 pixels on an H200.
fn set_block(place: Place, is_block: bool, thread: u32, v: vec3f) {
    block_film[3u * thread] = v.x;
    block_film[3u * thread + 1u] = v.y;
    block_film[3u * thread + 2u] = v.z;
    // The barrier must be reached by all threads, including those outside of their tile; only then
    // may some return.
    workgroupBarrier();
    if (!is_block) {
        return;
    }
    let local = thread % BLOCK_PIXELS;
    let first = 3u * (thread - local);
    let tile = tiles[place.tile];
    let left = place.x - tile.x - local % BLOCK_EDGE;
    let top = place.y - tile.y - local / BLOCK_EDGE;
    let floats = 3u * BLOCK_EDGE;
    for (var i = local; i < floats * BLOCK_EDGE; i += BLOCK_PIXELS) {
        let y = top + i / floats;
        let column = i % floats;
        // Blocks at the right and bottom edges extend beyond their tile, where the next addresses
        // belong to another tile.
        if (left + column / 3u < tile.width && y < tile.height) {
            film[3u * (tile.first_pixel + y * tile.width + left) + column] = block_film[first + i];
        }
    }
}
