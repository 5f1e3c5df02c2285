"""Solvers behind one interface: `prepare` brings a QP into a solver's own form, `solve` is what is timed.

Cold: the solver knows nothing of the QP before. Warm: it keeps what it can, from its memory to the last
solution. Tolerances are set so that solutions are as exact as those of Sidehill's controller, about 1e-6.
"""

import numpy as np
import scipy.sparse as sp

TOLERANCE = 1e-6
INFINITE = 1e20


class Solver:
    """A solver as it is to be timed."""

    name = ""
    #: Whether it can make use of the QP before.
    can_warm = True
    #: Whether it gets the QP of the inputs alone: it knows nothing of zeros.
    condensed = False

    def __init__(self, recording, warm):
        self.recording, self.warm = recording, warm

    def prepare(self, qp):
        """Not timed: conversions that a program which assembles for this solver would not need."""
        return qp

    def solve(self, prepared):
        """Timed. Returns x, or None where the solver says that it has no solution."""
        raise NotImplementedError


class Clarabel(Solver):
    name = "clarabel"

    def __init__(self, recording, warm):
        super().__init__(recording, warm)
        import clarabel

        self.lib, self.solver = clarabel, None
        self.settings = clarabel.DefaultSettings()
        self.settings.verbose = False
        if warm:
            self.settings.presolve_enable = False
            self.settings.input_sparse_dropzeros = False

    def solve(self, qp):
        if self.solver is None or not self.warm:
            rest = len(qp.b) - qp.equalities
            cones = [self.lib.ZeroConeT(qp.equalities), self.lib.NonnegativeConeT(rest)]
            self.solver = self.lib.DefaultSolver(qp.P_upper, qp.q, qp.A, qp.b, cones, self.settings)
        else:
            self.solver.update(P=qp.P_upper, q=qp.q, A=qp.A, b=qp.b)
        solution = self.solver.solve()
        solved = solution.status in (self.lib.SolverStatus.Solved, self.lib.SolverStatus.AlmostSolved)
        return np.array(solution.x) if solved else None


class TwoSided(Solver):
    """Base of those that take low <= G x <= high with equalities and bounds among the rows."""

    def prepare(self, qp):
        bounded = np.flatnonzero(np.isfinite(qp.x_low) | np.isfinite(qp.x_high))
        eye = sp.identity(len(qp.q), format="csr")[bounded]
        rows = sp.vstack([qp.E, qp.G, eye]).tocsc()
        low = np.concatenate([qp.e, qp.low, qp.x_low[bounded]])
        high = np.concatenate([qp.e, qp.high, qp.x_high[bounded]])
        return qp, qp.P_upper, rows, low, high


class Osqp(TwoSided):
    name = "osqp"

    def __init__(self, recording, warm):
        super().__init__(recording, warm)
        import osqp

        self.lib, self.solver = osqp, None

    def solve(self, prepared):
        qp, P, rows, low, high = prepared
        if self.solver is None or not self.warm:
            self.solver = self.lib.OSQP()
            self.solver.setup(
                P, qp.q, rows, low, high, verbose=False, eps_abs=TOLERANCE, eps_rel=TOLERANCE, max_iter=10000,
                warm_starting=self.warm,
            )
        else:
            self.solver.update(Px=P.data, Ax=rows.data, q=qp.q, l=low, u=high)
        result = self.solver.solve()
        return result.x if result.info.status_val == 1 else None


class Piqp(Solver):
    name = "piqp"
    sparse = True

    def __init__(self, recording, warm):
        super().__init__(recording, warm)
        import piqp

        self.lib, self.solver = piqp, None

    def _new(self):
        solver = self.lib.SparseSolver() if self.sparse else self.lib.DenseSolver()
        solver.settings.verbose = False
        solver.settings.eps_abs = solver.settings.eps_rel = TOLERANCE
        return solver

    def solve(self, qp):
        parts = (qp.P, qp.q, qp.E, qp.e, qp.G, qp.low, qp.high, qp.x_low, qp.x_high)
        if self.solver is None or not self.warm:
            self.solver = self._new()
            self.solver.setup(*parts)
        else:
            self.solver.update(*parts)
        status = self.solver.solve()
        return np.array(self.solver.result.x) if status == self.lib.PIQP_SOLVED else None


class PiqpMultistage(Piqp):
    name = "piqp multistage"

    def _new(self):
        solver = super()._new()
        solver.settings.kkt_solver = self.lib.KKTSolver.sparse_multistage
        return solver


class Dense(Solver):
    """Base of those that take dense matrices."""

    condensed = True

    def prepare(self, qp):
        return qp, qp.P.toarray(), np.asarray(sp.vstack([qp.E, qp.G]).toarray())


class Daqp(Dense):
    name = "daqp"

    def __init__(self, recording, warm):
        super().__init__(recording, warm)
        import daqp

        self.lib, self.multipliers = daqp, None

    def prepare(self, qp):
        qp, P, rows = super().prepare(qp)
        high = np.concatenate([np.minimum(qp.x_high, INFINITE), qp.e, qp.high])
        low = np.concatenate([np.maximum(qp.x_low, -INFINITE), qp.e, np.maximum(qp.low, -INFINITE)])
        sense = np.zeros(len(high), dtype=np.intc)
        sense[len(qp.q) : len(qp.q) + len(qp.e)] = 5
        return P, qp.q.copy(), np.ascontiguousarray(rows), high, low, sense

    def solve(self, prepared):
        start = {"dual_start": self.multipliers} if self.warm and self.multipliers is not None else {}
        x, _, status, info = self.lib.solve(*prepared, **start)
        self.multipliers = info["lam"] if status == 1 else None
        return x if status == 1 else None


class Proxqp(Solver):
    name = "proxqp"
    condensed = True

    def __init__(self, recording, warm):
        super().__init__(recording, warm)
        import proxsuite

        self.lib, self.solver = proxsuite.proxqp, None

    def prepare(self, qp):
        box = lambda bound: np.clip(bound, -INFINITE, INFINITE)  # noqa: E731
        return (
            qp.P.toarray(), qp.q, qp.E.toarray(), qp.e, qp.G.toarray(), box(qp.low), box(qp.high),
            box(qp.x_low), box(qp.x_high),
        )

    def solve(self, parts):
        if self.solver is None or not self.warm:
            n, equalities, rows = len(parts[1]), len(parts[3]), len(parts[5])
            self.solver = self.lib.dense.QP(n, equalities, rows, True)
            self.solver.settings.eps_abs = TOLERANCE
            if self.warm:
                self.solver.settings.initial_guess = self.lib.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
            self.solver.init(*parts)
        else:
            self.solver.update(*parts)
        self.solver.solve()
        status = self.solver.results.info.status
        return self.solver.results.x.copy() if status == self.lib.QPSolverOutput.PROXQP_SOLVED else None


class Highs(TwoSided):
    name = "highs"
    can_warm = False

    def __init__(self, recording, warm):
        super().__init__(recording, warm)
        import highspy

        self.lib = highspy

    def prepare(self, qp):
        rows = sp.vstack([qp.E, qp.G]).tocsc()
        lower = sp.tril(qp.P).tocsc()
        return qp, lower, rows, np.concatenate([qp.e, qp.low]), np.concatenate([qp.e, qp.high])

    def solve(self, prepared):
        qp, lower, rows, low, high = prepared
        highs, model = self.lib.Highs(), self.lib.HighsModel()
        highs.setOptionValue("output_flag", False)
        lp, hessian = model.lp_, model.hessian_
        lp.num_col_, lp.num_row_ = len(qp.q), rows.shape[0]
        lp.col_cost_, lp.col_lower_, lp.col_upper_ = qp.q, qp.x_low, qp.x_high
        lp.row_lower_, lp.row_upper_ = low, high
        lp.a_matrix_.format_ = self.lib.MatrixFormat.kColwise
        lp.a_matrix_.start_, lp.a_matrix_.index_, lp.a_matrix_.value_ = rows.indptr, rows.indices, rows.data
        hessian.dim_, hessian.format_ = len(qp.q), self.lib.HessianFormat.kTriangular
        hessian.start_, hessian.index_, hessian.value_ = lower.indptr, lower.indices, lower.data
        highs.passModel(model)
        highs.run()
        optimal = highs.getModelStatus() == self.lib.HighsModelStatus.kOptimal
        return np.array(highs.getSolution().col_value) if optimal else None


class Ecos(Solver):
    """A QP as a second-order cone program, by qpsolvers."""

    name = "ecos"
    condensed = True
    can_warm = False

    def __init__(self, recording, warm):
        super().__init__(recording, warm)
        import ecos  # noqa: F401
        from qpsolvers.solvers.ecos_ import ecos_solve_qp

        self.function = ecos_solve_qp

    def prepare(self, qp):
        rows = np.vstack([qp.G.toarray(), np.eye(len(qp.q))])
        low, high = np.concatenate([qp.low, qp.x_low]), np.concatenate([qp.high, qp.x_high])
        above, below = np.isfinite(high), np.isfinite(low)
        return qp.P.toarray(), qp.q, np.vstack([rows[above], -rows[below]]), np.concatenate([high[above], -low[below]])

    def solve(self, parts):
        return self.function(*parts)


class Scs(Solver):
    name = "scs"

    def __init__(self, recording, warm):
        super().__init__(recording, warm)
        import scs

        self.lib, self.last = scs, None

    def solve(self, qp):
        data = {"P": qp.P_upper, "A": qp.A, "b": qp.b, "c": qp.q}
        cone = {"z": qp.equalities, "l": len(qp.b) - qp.equalities}
        settings = {"verbose": False, "eps_abs": TOLERANCE, "eps_rel": TOLERANCE, "max_iters": 5000}
        solver = self.lib.SCS(data, cone, **settings)
        if self.warm and self.last is not None:
            result = solver.solve(warm_start=True, x=self.last["x"], y=self.last["y"], s=self.last["s"])
        else:
            result = solver.solve()
        self.last = result
        return result["x"] if result["info"]["status_val"] == 1 else None
