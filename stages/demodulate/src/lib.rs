//! turbid demodulate.
