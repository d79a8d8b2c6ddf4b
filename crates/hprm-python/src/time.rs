//! Times as programs give them: numbers of nanoseconds, texts such as `"10 ms"`, and Python's `timedelta`.

use hprm_core::Nanos;
use hprm_lf::{WrongTime, parse_time};
use pyo3::exceptions::{PyOverflowError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDelta, PyDeltaAccess, PyFloat, PyString};

/// Nanoseconds of a day, a second and a microsecond: what a `timedelta` counts.
const UNITS: [i128; 3] = [86_400_000_000_000, 1_000_000_000, 1_000];

/// The name of an object's type, for messages.
pub(crate) fn kind(object: &Bound<'_, PyAny>) -> String {
    object.get_type().name().map_or_else(|_| "thing".to_owned(), |name| name.to_string())
}

/// The nanoseconds of a time: of a number, which may be a float, as of `MSEC(1.5)`; of a text with a unit, such
/// as `"10 ms"`; of a `timedelta`.
///
/// # Errors
///
/// `TypeError` if it is nothing of that, `ValueError` or `OverflowError` if it is no time.
pub(crate) fn nanos(time: &Bound<'_, PyAny>) -> PyResult<Nanos> {
    if let Ok(number) = time.cast::<PyFloat>() {
        return of_float(number.value());
    }
    time.extract().or_else(|error: PyErr| {
        if let Ok(text) = time.cast::<PyString>() {
            of_text(text.to_str()?)
        } else if let Ok(delta) = time.cast::<PyDelta>() {
            of_delta(delta)
        } else if error.is_instance_of::<PyTypeError>(time.py()) {
            let kind = kind(time);
            Err(PyTypeError::new_err(format!(
                "a time must be a number of nanoseconds, such as MSEC(10), a text with a unit, such as \
                 \"10 ms\", or a timedelta, and this is a {kind}"
            )))
        } else if error.is_instance_of::<PyOverflowError>(time.py()) {
            Err(PyOverflowError::new_err(too_long(&time.to_string())))
        } else {
            Err(error)
        }
    })
}

/// The nanoseconds of a time that a program states. The unit is in doubt of a float, and a time that is stated
/// counts forward.
///
/// # Errors
///
/// `TypeError` if it is nothing that states a time, `ValueError` if it is no such time.
#[pyfunction]
#[pyo3(name = "nanoseconds", signature = (time, /))]
pub(crate) fn stated_nanos(time: &Bound<'_, PyAny>) -> PyResult<Nanos> {
    let refuse = |what: String| {
        let expected = "a time is \"10 ms\", a timedelta, or a whole number of nanoseconds";
        PyTypeError::new_err(format!("{expected}, and this is {what}"))
    };
    if time.is_instance_of::<PyBool>() {
        return Err(refuse(time.to_string()));
    }
    if let Ok(number) = time.cast::<PyFloat>() {
        let number = number.value();
        let fixed = format!("{number:.9}");
        let seconds = fixed.trim_end_matches('0').trim_end_matches('.');
        return Err(refuse(match number.is_finite() {
            true => format!("the float {time}: write \"{seconds} s\""),
            false => format!("the float {time}"),
        }));
    }
    match nanos(time) {
        Ok(nanos) if nanos < 0 => {
            Err(PyValueError::new_err(format!("a time counts forward, and {time} is negative")))
        }
        Err(error) if error.is_instance_of::<PyTypeError>(time.py()) => {
            Err(refuse(format!("a {}", kind(time))))
        }
        Err(error) if error.is_instance_of::<PyOverflowError>(time.py()) => {
            Err(PyValueError::new_err(error.value(time.py()).to_string()))
        }
        read => read,
    }
}

fn of_float(number: f64) -> PyResult<Nanos> {
    if number != 0.0 && number.abs() < 1.0 {
        return Err(PyValueError::new_err(format!(
            "a time is a number of nanoseconds, and {number} is less than one: SEC({number}) is in seconds"
        )));
    }
    // Of the floats beyond, none is a number of 64 bits; the cast of one within is exact enough.
    if number.abs() < i64::MAX as f64 {
        Ok(number as i64)
    } else {
        Err(PyValueError::new_err(format!("{number} is no number of nanoseconds")))
    }
}

fn of_text(text: &str) -> PyResult<Nanos> {
    parse_time(text).map_err(|wrong| match wrong {
        WrongTime::Text => PyValueError::new_err(format!(
            "a time is a number with a unit (ns, us, ms, s, min, h, d or week), such as \"10 ms\", and \
             {text:?} is not"
        )),
        WrongTime::TooFine => PyValueError::new_err(format!(
            "a time is a whole number of nanoseconds, and {text:?} is not"
        )),
        WrongTime::TooLong => PyValueError::new_err(too_long(&format!("{text:?}"))),
    })
}

fn of_delta(delta: &Bound<'_, PyDelta>) -> PyResult<Nanos> {
    let parts = [delta.get_days(), delta.get_seconds(), delta.get_microseconds()];
    let nanos: i128 =
        parts.into_iter().zip(UNITS).map(|(part, unit)| i128::from(part) * unit).sum();
    Nanos::try_from(nanos).map_err(|_| PyOverflowError::new_err(too_long(&delta.to_string())))
}

fn too_long(time: &str) -> String {
    let most = Nanos::MAX;
    format!("a time has at most {most} nanoseconds, which is 292 years, and this is {time}")
}
