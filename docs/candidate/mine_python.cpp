// The functions of candidate.h as a Python class for skfem_stvk.verify(candidate=...): energy, internal_force and tangent of u.
#include "candidate.h"
#include <pybind11/numpy.h>
#include <stdexcept>

namespace py = pybind11;
template <class Number> using Array = py::array_t<Number, py::array::c_style | py::array::forcecast>;

static void check(int code) { if (code) throw std::runtime_error("the library returned " + std::to_string(code)); }

struct Mine {
    Mine(Array<double> nodes, Array<int64_t> elements, Array<double> young, Array<double> poisson) {
        check(mine_body(nodes.shape(0), nodes.shape(1), nodes.data(), elements.shape(0), elements.shape(1), elements.data(),
                        young.data(), poisson.data()));
    }
    double energy(Array<double> u) { double W; check(mine_W(u.data(), &W)); return W; }
    py::object internal_force(Array<double> u) { Array<double> F(u.size()); check(mine_F(u.data(), F.mutable_data())); return F; }
    py::object tangent(Array<double> u) {
        int64_t n; const int64_t *rows, *columns; const double *values;
        check(mine_K(u.data(), &n, &rows, &columns, &values));
        auto ids = py::make_tuple(Array<int64_t>(n, rows), Array<int64_t>(n, columns));                     // these are copies
        return py::module_::import("scipy.sparse").attr("coo_matrix")(py::make_tuple(Array<double>(n, values), ids),
                                                                      py::arg("shape") = py::make_tuple(u.size(), u.size()));
    }
};

PYBIND11_MODULE(mine_python, m) {
    py::class_<Mine>(m, "Mine").def(py::init<Array<double>, Array<int64_t>, Array<double>, Array<double>>())
        .def("energy", &Mine::energy).def("internal_force", &Mine::internal_force).def("tangent", &Mine::tangent);
}
