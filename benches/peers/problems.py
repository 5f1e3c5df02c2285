"""The QPs that `sidehill simulate --record-qps FILE` wrote, in the forms that solvers take.

As recorded: minimise 1/2 x' P x + q' x subject to A x + s = b, where s = 0 in the first rows and s >= 0
in the others; all QPs of a file have one sparsity pattern. x has, stage by stage, the state at a stage's end and its
inputs.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

#: Variables of a stage, of which the first are its state.
VARIABLES, STATES = 5, 3


@dataclass
class Qp:
    """One QP in all forms; matrices of a form keep their pattern from QP to QP."""

    P: sp.csc_matrix  # both triangles
    P_upper: sp.csc_matrix
    q: np.ndarray
    A: sp.csc_matrix  # as recorded, one-sided
    b: np.ndarray
    equalities: int
    # Two-sided: E x = e, low <= G x <= high, x_low <= x <= x_high.
    E: sp.csc_matrix
    e: np.ndarray
    G: sp.csc_matrix
    low: np.ndarray
    high: np.ndarray
    x_low: np.ndarray
    x_high: np.ndarray
    #: x of the recorded QP by that of a condensed one.
    lift: np.ndarray | None = None

    def cost(self, x):
        return 0.5 * x @ (self.P @ x) + self.q @ x

    def violation(self, x):
        """Largest violation of a row."""
        rest = self.A @ x - self.b
        first = self.equalities
        return max(np.abs(rest[:first]).max(initial=0.0), rest[first:].max(initial=0.0))


    def condensed(self):
        """Returns the same QP of the inputs alone, with dense matrices."""
        inputs = np.arange(len(self.q)) % VARIABLES >= STATES
        E, own = self.E.toarray(), np.eye(len(self.q))[:, inputs]
        own[~inputs] = -np.linalg.solve(E[:, ~inputs], E[:, inputs])
        P = own.T @ (self.P @ own)
        return Qp(
            P=sp.csc_matrix(P),
            P_upper=sp.csc_matrix(np.triu(P)),
            q=own.T @ self.q,
            A=None,
            b=None,
            equalities=0,
            E=sp.csc_matrix((0, P.shape[0])),
            e=np.zeros(0),
            G=sp.csc_matrix(self.G @ own),
            low=self.low,
            high=self.high,
            x_low=self.x_low[inputs],
            x_high=self.x_high[inputs],
            lift=own,
        )


class Recording:
    """The QPs of a file."""

    def __init__(self, path):
        with np.load(path) as data:
            self.data = {name: data[name] for name in data.files}
        self.equalities = int(self.data["equalities"])
        self.variables = self.data["q"].shape[1]
        self.rows = self.data["b"].shape[1]
        self.iterations = self.data["iterations"]
        self._pair()

    def __len__(self):
        return len(self.data["q"])

    def _matrix(self, name, index, shape):
        parts = (self.data[f"{name}_data"][index], self.data[f"{name}_indices"], self.data[f"{name}_indptr"])
        return sp.csc_matrix(parts, shape=shape)

    def _pair(self):
        """Finds the rows that are bounds of one variable, and those that bound the same term from both
        sides."""
        A = self._matrix("A", 0, (self.rows, self.variables)).tocsr()
        self.bound_rows, self.above, self.below, self.term_rows = [], [], [], []
        open_terms = {}
        for row in range(self.equalities, self.rows):
            stored = slice(A.indptr[row], A.indptr[row + 1])
            columns, values = A.indices[stored], A.data[stored]
            if len(columns) == 1:
                self.bound_rows.append((row, columns[0]))
                continue
            key = tuple(columns)
            opposite = (key, tuple(-values))
            if opposite in open_terms:
                self.below[open_terms.pop(opposite)] = row
            else:
                open_terms[(key, tuple(values))] = len(self.term_rows)
                self.term_rows.append(row)
                self.above.append(row)
                self.below.append(-1)
        self.below = np.array(self.below, dtype=int)
        self.above = np.array(self.above, dtype=int)

    def __getitem__(self, index):
        upper = self._matrix("P", index, (self.variables, self.variables))
        # By entries: a sum of matrices would drop the pattern's zeros.
        entries = upper.tocoo()
        rows, columns, values = entries.row, entries.col, entries.data
        off = rows != columns
        both = (np.concatenate([rows, columns[off]]), np.concatenate([columns, rows[off]]))
        P = sp.csc_matrix((np.concatenate([values, values[off]]), both), shape=upper.shape)
        P.sort_indices()
        A = self._matrix("A", index, (self.rows, self.variables))
        by_row = A.tocsr()
        b, first = self.data["b"][index], self.equalities
        x_low, x_high = np.full(self.variables, -np.inf), np.full(self.variables, np.inf)
        for row, column in self.bound_rows:
            value = by_row.data[by_row.indptr[row]]
            if value > 0:
                x_high[column] = min(x_high[column], b[row] / value)
            elif value < 0:
                x_low[column] = max(x_low[column], b[row] / value)
        low = np.where(self.below >= 0, -b[self.below], -np.inf)
        return Qp(
            P=P,
            P_upper=upper,
            q=self.data["q"][index],
            A=A,
            b=b,
            equalities=first,
            E=by_row[:first].tocsc(),
            e=b[:first],
            G=by_row[self.term_rows].tocsc(),
            low=low,
            high=b[self.above],
            x_low=x_low,
            x_high=x_high,
        )
