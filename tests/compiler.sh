#!/bin/sh
# What cargo runs in the place of rustc for the crates of this workspace in `make test`: clippy's driver, which lints
# and compiles. Simulation needs optimized crates; their own tests do not, and compile in a quarter of the time without.
case $CARGO_PKG_NAME in
hprm-core | hprm-federated)
	for word; do
		if [ "$word" = --test ]; then
			exec clippy-driver "$@" -C opt-level=0
		fi
	done
	;;
esac
exec clippy-driver "$@"
