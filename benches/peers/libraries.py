"""HPIPM and qpOASES, called in the shared libraries of acados."""

import ctypes
import pathlib

import numpy as np

from problems import STATES, VARIABLES
from solvers import INFINITE, TOLERANCE, Dense, Solver


def library(name):
    import acados

    folder = pathlib.Path(next(iter(acados.__path__))) / "install" / "lib"
    for needed in ("libblasfeo.so", "libhpipm.so") if name == "libhpipm.so" else ():
        ctypes.CDLL(str(folder / needed), mode=ctypes.RTLD_GLOBAL)
    return ctypes.CDLL(str(folder / name))


def pointer(array):
    return array.ctypes.data_as(ctypes.c_void_p)


class Hpipm(Solver):
    """The QP as the optimal control problem that it is: a stage's state is that of the vehicle with the inputs before,
    to which the cost of changes ties its own."""

    name = "hpipm"
    #: SPEED of hpipm_common.h
    MODE = 1

    def __init__(self, recording, warm):
        super().__init__(recording, warm)
        self.lib = library("libhpipm.so")
        self.problem = None

    def prepare(self, qp):
        return Stages(qp)

    def _create(self, kind, *arguments):
        """Returns a new struct of HPIPM, as large as it says."""
        lib = self.lib
        size, memory = getattr(lib, f"d_{kind}_strsize"), getattr(lib, f"d_{kind}_memsize")
        size.restype = memory.restype = ctypes.c_size_t
        struct = ctypes.create_string_buffer(size())
        held = ctypes.create_string_buffer(memory(*arguments) + 64)
        getattr(lib, f"d_{kind}_create")(*arguments, struct, held)
        self.held.append(held)
        return struct

    def _set_up(self, stages):
        self.held = []
        last = len(stages.blocks) - 1
        # dim's create takes its size before the struct, as the others do.
        dim = self.dim = self._create("ocp_qp_dim", ctypes.c_int(last))
        for k, block in enumerate(stages.blocks):
            for field, value in (("nx", block.nx), ("nu", block.nu), ("nbu", block.nu), ("ng", block.ng)):
                self.lib.d_ocp_qp_dim_set(field.encode(), k, value, dim)
        self.problem = self._create("ocp_qp", dim)
        self.solution = self._create("ocp_qp_sol", dim)
        self.arguments = self._create("ocp_qp_ipm_arg", dim)
        self.lib.d_ocp_qp_ipm_arg_set_default(self.MODE, self.arguments)
        for name in ("stat", "eq", "ineq", "comp"):
            value = ctypes.c_double(TOLERANCE)
            getattr(self.lib, f"d_ocp_qp_ipm_arg_set_tol_{name}")(ctypes.byref(value), self.arguments)
        for name, number in (("iter_max", 100), ("warm_start", 2 if self.warm else 0)):
            value = ctypes.c_int(number)
            getattr(self.lib, f"d_ocp_qp_ipm_arg_set_{name}")(ctypes.byref(value), self.arguments)
        self.workspace = self._create("ocp_qp_ipm_ws", dim, self.arguments)

    def solve(self, stages):
        if self.problem is None:
            self._set_up(stages)
            if self.warm:
                # The first solve has nothing to begin with.
                cold = ctypes.c_int(0)
                self.lib.d_ocp_qp_ipm_arg_set_warm_start(ctypes.byref(cold), self.arguments)
        self.lib.d_ocp_qp_set_all(*stages.pointers, self.problem)
        self.lib.d_ocp_qp_ipm_solve(self.problem, self.solution, self.arguments, self.workspace)
        if self.warm:
            warm = ctypes.c_int(2)
            self.lib.d_ocp_qp_ipm_arg_set_warm_start(ctypes.byref(warm), self.arguments)
        status = ctypes.c_int(-1)
        self.lib.d_ocp_qp_ipm_get_status(self.workspace, ctypes.byref(status))
        return stages.read(self.lib, self.solution) if status.value == 0 else None


class Stage:
    """One stage's matrices, column-major as HPIPM reads them."""


class Stages:
    """A recorded QP as HPIPM's optimal control problem: what the recording has of a stage's end and inputs is the state of
    the stage after it."""

    def __init__(self, qp):
        P, E, G = qp.P.toarray(), qp.E.toarray(), qp.G.toarray()
        count = len(qp.q) // VARIABLES
        last_column = np.array([np.flatnonzero(row).max() for row in G])
        fortran = lambda matrix: np.array(matrix, dtype=float, order="F")  # noqa: E731
        clip = lambda bound: np.clip(bound, -INFINITE, INFINITE)  # noqa: E731
        self.blocks, self.count = [], count
        for k in range(count + 1):
            x = np.arange(VARIABLES * (k - 1), VARIABLES * k) if k else np.arange(0)
            own = np.arange(VARIABLES * k, VARIABLES * (k + 1)) if k < count else np.arange(0)
            u = own[STATES:]
            rows = np.flatnonzero(last_column // VARIABLES == k)
            stage = Stage()
            stage.nx, stage.nu, stage.ng = len(x), len(u), len(rows)
            # What the inputs cost by themselves they cost as part of the next stage's state.
            stage.Q, stage.q = fortran(P[np.ix_(x, x)]), qp.q[x].copy()
            stage.S, stage.R, stage.r = fortran(P[np.ix_(u, x)]), np.zeros((len(u), len(u)), order="F"), np.zeros(len(u))
            stage.C, stage.D = fortran(G[np.ix_(rows, x)]), fortran(G[np.ix_(rows, u)])
            stage.lg, stage.ug = clip(qp.low[rows]), clip(qp.high[rows])
            stage.lbu, stage.ubu = clip(qp.x_low[u]), clip(qp.x_high[u])
            stage.idxbu = np.arange(len(u), dtype=np.intc)
            if k < count:
                dynamics = slice(STATES * k, STATES * (k + 1))
                stage.A, stage.B = np.zeros((VARIABLES, len(x)), order="F"), np.zeros((VARIABLES, len(u)), order="F")
                stage.A[:STATES], stage.B[:STATES] = -E[dynamics][:, x], -E[dynamics][:, u]
                stage.B[STATES:] = np.eye(len(u))
                stage.b = np.concatenate([qp.e[dynamics], np.zeros(len(u))])
            self.blocks.append(stage)
        self.pointers = [self._array(name) for name in (
            "A", "B", "b", "Q", "S", "R", "q", "r", "idxbx", "lbx", "ubx", "idxbu", "lbu", "ubu", "C", "D",
            "lg", "ug", "Zl", "Zu", "zl", "zu", "idxs", "ls", "us",
        )]

    def _array(self, name):
        array = (ctypes.c_void_p * len(self.blocks))()
        for k, block in enumerate(self.blocks):
            matrix = getattr(block, name, None)
            array[k] = matrix.ctypes.data if matrix is not None else None
        return array

    def read(self, lib, solution):
        x = np.zeros((self.count, VARIABLES))
        for k in range(self.count):
            lib.d_ocp_qp_sol_get_x(k + 1, solution, pointer(x[k]))
        return x.ravel()


class Qpoases(Dense):
    """The C version of qpOASES, with its default options. Its hot start keeps the matrices, which change
    with each of these QPs: cold only."""

    name = "qpoases"
    can_warm = False

    def __init__(self, recording, warm):
        super().__init__(recording, warm)
        self.lib = library("libqpOASES_e.so")
        self.lib.QProblem_createMemory.restype = ctypes.c_void_p
        self.problem = None

    def prepare(self, qp):
        qp, P, rows = super().prepare(qp)
        box = lambda bound: np.clip(bound, -INFINITE, INFINITE)  # noqa: E731
        return [np.ascontiguousarray(part) for part in (
            P, qp.q, rows, box(qp.x_low), box(qp.x_high), np.concatenate([qp.e, box(qp.low)]),
            np.concatenate([qp.e, box(qp.high)]),
        )]

    def solve(self, parts):
        size, rows = len(parts[1]), len(parts[5])
        if self.problem is None:
            self.problem = ctypes.c_void_p(self.lib.QProblem_createMemory(size, rows))
        self.lib.QProblemCON(self.problem, size, rows, 3)  # HST_POSDEF
        self.lib.QProblem_setPrintLevel(self.problem, 0)
        changes = ctypes.c_int(1000)
        status = self.lib.QProblem_init(
            self.problem, *(pointer(part) for part in parts), ctypes.byref(changes), None
        )
        if status != 0:
            return None
        x = np.zeros(size)
        self.lib.QProblem_getPrimalSolution(self.problem, pointer(x))
        return x
