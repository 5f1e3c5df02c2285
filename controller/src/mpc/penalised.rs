//! The equality-constrained QP whose P has room for penalties on all inequalities.

use super::problem::{QpData, pattern};
use super::rows::Rows;

/// Where values stand in the penalised P and in A.
#[derive(Clone)]
pub struct Places {
    /// Of P's values.
    pub p: Vec<usize>,
    /// Of P's diagonal.
    pub diagonal: Vec<usize>,
    /// Of each product of two entries of a row, row by row: (0, 0), (0, 1), (1, 1), (0, 2), ...
    pub products: Vec<usize>,
    /// First product of each row.
    pub product_starts: Vec<usize>,
    /// Of A's values in the equalities' rows.
    pub equalities: Vec<usize>,
}

/// Returns the problem without its inequalities, whose P has room for the penalties of all rows, and
/// the positions of the values in it.
pub fn penalised(data: &QpData, rows: &Rows) -> (QpData, Places) {
    let size = data.q.len();
    let mut entries: Vec<(usize, usize)> = (0..size).map(|i| (i, i)).collect();
    let own: Vec<_> = (0..size)
        .flat_map(|column| {
            let stored = data.p.colptr[column]..data.p.colptr[column + 1];
            stored.map(move |place| (data.p.rowval[place], column))
        })
        .collect();
    entries.extend(&own);
    let mut products = Vec::new();
    let mut product_starts = vec![0];
    for row in 0..rows.count() {
        let columns = rows.columns(row);
        for (i, column) in columns.iter().enumerate() {
            products.extend(columns[..=i].iter().map(|other| (*other, *column)));
        }
        product_starts.push(products.len());
    }
    entries.extend(&products);
    entries.sort_unstable();
    entries.dedup();
    let (p, positions) = pattern(size, size, &entries);
    let places = |list: &[(usize, usize)]| -> Vec<usize> {
        list.iter()
            .filter_map(|entry| entries.binary_search(entry).ok())
            .map(|i| positions[i])
            .collect()
    };
    let diagonal: Vec<_> = (0..size).map(|i| (i, i)).collect();
    let equalities = data.a.rowval.iter().enumerate();
    let places = Places {
        p: places(&own),
        diagonal: places(&diagonal),
        products: places(&products),
        product_starts,
        equalities: equalities
            .filter(|(_, row)| **row < data.equalities)
            .map(|(place, _)| place)
            .collect(),
    };
    let mut problem = data.without_inequalities();
    problem.p = p;
    (problem, places)
}
