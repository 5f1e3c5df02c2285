//! Places in the plane, sorted into square cells so that those near a place are found in bounded
//! time.

/// An item with its place.
pub(super) trait Placed {
    /// Returns (X_g, Y_g), m.
    fn place_in_world(&self) -> [f64; 2];
}

/// Items sorted by the square cell they lie in.
#[derive(Debug)]
pub(super) struct Cells<T> {
    cell_m: f64,
    /// Row and column of each item's cell, ascending.
    keys: Vec<(i64, i64)>,
    items: Vec<T>,
}

impl<T: Placed> Cells<T> {
    /// Returns the items in cells of side `cell_m`, items of a cell in the order given.
    pub(super) fn new(cell_m: f64, items: Vec<T>) -> Self {
        let mut keyed: Vec<((i64, i64), T)> = items
            .into_iter()
            .map(|item| (key(cell_m, item.place_in_world()), item))
            .collect();
        keyed.sort_by_key(|(key, _)| *key);
        let (keys, items) = keyed.into_iter().unzip();
        Self {
            cell_m,
            keys,
            items,
        }
    }

    /// Returns all items within `cell_m` of a place, and some beyond: those of the nine cells around.
    pub(super) fn near(&self, place_in_world: [f64; 2]) -> impl Iterator<Item = &T> {
        let (row, column) = key(self.cell_m, place_in_world);
        (-1..=1).flat_map(move |up| {
            let first = (row + up, column - 1);
            let last = (row + up, column + 1);
            let begin = self.keys.partition_point(|k| *k < first);
            let length = self.keys[begin..].partition_point(|k| *k <= last);
            &self.items[begin..begin + length]
        })
    }
}

fn key(cell_m: f64, [x_m, y_m]: [f64; 2]) -> (i64, i64) {
    // A cast saturates, and the places beyond a billion cells may share one: that leaves room for +-1.
    let index = |m: f64| (m / cell_m).floor().clamp(-1e9, 1e9) as i64;
    (index(y_m), index(x_m))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[derive(Debug, Clone, Copy, PartialEq)]
    struct Dot(f64, f64);

    impl Placed for Dot {
        fn place_in_world(&self) -> [f64; 2] {
            [self.0, self.1]
        }
    }

    proptest! {
        #[test]
        fn nothing_near_is_missed(dots in prop::collection::vec((-9.0..9.0f64, -9.0..9.0f64), 0..60),
                                  x in -10.0..10.0f64, y in -10.0..10.0f64) {
            let dots: Vec<Dot> = dots.into_iter().map(|(x, y)| Dot(x, y)).collect();
            let cells = Cells::new(1.5, dots.clone());
            let found: Vec<Dot> = cells.near([x, y]).copied().collect();
            for dot in dots {
                if (dot.0 - x).hypot(dot.1 - y) <= 1.5 {
                    prop_assert!(found.contains(&dot));
                }
            }
        }
    }
}
