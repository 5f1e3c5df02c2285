//! A QP's inequalities row by row: their matrix is stored by columns.

use super::problem::QpData;

/// Where the entries of the inequalities' rows stand. Row 0 is the first after the equalities.
#[derive(Debug, Clone)]
pub struct Rows {
    /// First entry of each row, and one past the last.
    starts: Vec<usize>,
    columns: Vec<usize>,
    /// Where each entry stands among A's values.
    places: Vec<usize>,
    /// Numbers of the QP's variables, rows, and values of A.
    sizes: (usize, usize, usize),
}

impl Rows {
    /// Returns the inequalities' rows of problems with the pattern of `data`.
    pub fn new(data: &QpData) -> Self {
        let count = data.b.len() - data.equalities;
        let mut rows: Vec<Vec<(usize, usize)>> = vec![Vec::new(); count];
        for column in 0..data.a.n {
            for place in data.a.colptr[column]..data.a.colptr[column + 1] {
                if let Some(row) = data.a.rowval[place].checked_sub(data.equalities) {
                    rows[row].push((column, place));
                }
            }
        }
        let mut starts = vec![0];
        for row in &rows {
            starts.push(starts[starts.len() - 1] + row.len());
        }
        let (columns, places) = rows.into_iter().flatten().unzip();
        Self {
            starts,
            columns,
            places,
            sizes: (data.q.len(), data.b.len(), data.a.nzval.len()),
        }
    }

    /// Returns whether `data` has the size of the problem whose rows these are.
    pub fn fit(&self, data: &QpData) -> bool {
        (data.q.len(), data.b.len(), data.a.nzval.len()) == self.sizes
    }

    /// Returns the number of rows.
    pub fn count(&self) -> usize {
        self.starts.len() - 1
    }

    /// Returns the columns in which a row has entries.
    pub fn columns(&self, row: usize) -> &[usize] {
        &self.columns[self.starts[row]..self.starts[row + 1]]
    }

    /// Returns the last entry of a row, which has one.
    pub fn last(&self, data: &QpData, row: usize) -> f64 {
        data.a.nzval[self.places[self.starts[row + 1] - 1]]
    }

    /// Returns a row's entries, each with its column.
    pub fn entries<'a>(
        &'a self,
        data: &'a QpData,
        row: usize,
    ) -> impl Iterator<Item = (usize, f64)> + Clone + 'a {
        let own = self.starts[row]..self.starts[row + 1];
        let places = self.places[own].iter();
        let columns = self.columns(row).iter();
        columns
            .zip(places)
            .map(|(column, place)| (*column, data.a.nzval[*place]))
    }
}
