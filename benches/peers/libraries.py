"""HPIPM and qpOASES, called in the shared libraries of acados."""

import ctypes
import pathlib

import numpy as np
import scipy.sparse as sp

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
    """The QP as the optimal control problem that it is: a stage is a block, its state the block's first
    state with the inputs before it, to which the cost of changes ties the block's own."""

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


class Block:
    """One stage's matrices, column-major as HPIPM reads them."""

    def __init__(self, nx, nu, ng):
        self.nx, self.nu, self.ng = nx, nu, ng


class Stages:
    """A recorded QP without a corridor as HPIPM's optimal control problem."""

    def __init__(self, qp):
        P, E, G = qp.P.toarray(), qp.E.toarray(), qp.G.toarray()
        states = state_columns(E)
        starts = [0] + [columns[0] for columns in states]
        ends = starts[1:] + [len(qp.q)]
        self.blocks, self.columns = [], []
        before = None
        fortran = lambda matrix: np.array(matrix, dtype=float, order="F")  # noqa: E731
        for k, (start, end) in enumerate(zip(starts, ends)):
            x = list(range(start, start + 3)) if k else []
            u = list(range(start + len(x), end))
            carried = before[-2:] if before is not None else []
            state = x + carried
            rows = [
                row for row in range(G.shape[0])
                if np.flatnonzero(G[row]).max() in u
            ]
            block = Block(len(state), len(u), len(rows))
            block.Q = np.zeros((block.nx, block.nx), order="F")
            block.Q[: len(x), : len(x)] = P[np.ix_(x, x)]
            # The last inputs of the block before cost there; here only their tie to the first ones.
            block.S = fortran(P[np.ix_(u, state)])
            block.R, block.r = fortran(P[np.ix_(u, u)]), qp.q[u].copy()
            block.q = np.concatenate([qp.q[x], np.zeros(len(carried))])
            block.C, block.D = fortran(G[np.ix_(rows, state)]), fortran(G[np.ix_(rows, u)])
            clip = lambda bound: np.clip(bound, -INFINITE, INFINITE)  # noqa: E731
            block.lg, block.ug = clip(qp.low[rows]), clip(qp.high[rows])
            block.lbu, block.ubu = clip(qp.x_low[u]), clip(qp.x_high[u])
            block.idxbu = np.arange(len(u), dtype=np.intc)
            if k + 1 < len(starts):
                own = slice(3 * k, 3 * k + 3)
                block.A, block.B = np.zeros((5, block.nx), order="F"), np.zeros((5, block.nu), order="F")
                block.A[:3, : len(x)], block.B[:3] = -E[own][:, x], -E[own][:, u]
                block.B[3, -2], block.B[4, -1] = 1.0, 1.0
                block.b = np.concatenate([qp.e[own], np.zeros(2)])
            self.blocks.append(block)
            self.columns.append((x, u))
            before = u
        self.size = len(qp.q)
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
        x = np.zeros(self.size)
        for k, ((states, inputs), block) in enumerate(zip(self.columns, self.blocks)):
            u, state = np.zeros(block.nu), np.zeros(max(block.nx, 1))
            lib.d_ocp_qp_sol_get_u(k, solution, pointer(u))
            x[inputs] = u
            if block.nx:
                lib.d_ocp_qp_sol_get_x(k, solution, pointer(state))
                x[states] = state[:3]
        return x


def state_columns(E):
    """Returns the columns of each block's state: those with the 1 of a continuity row."""
    states = []
    for row in range(0, E.shape[0], 3):
        states.append([int(np.flatnonzero(E[row + i]).max()) for i in range(3)])
    return states


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
