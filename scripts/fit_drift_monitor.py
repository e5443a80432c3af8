#!/usr/bin/env python3
"""Fits the constants of probabilityOf in src/core/drift_monitor.cpp.

    evaluate kitti_00 --frame-set even --monitor a.csv --frames 1,2,3,5,8,12 --trials 30
    simulate_drive --dataset drive --frames 25 --rate 0.05 --seed 5
    evaluate drive --frame-set even --monitor b.csv --frames 1,2,3,5,8,12 --trials 30
    scripts/fit_drift_monitor.py a.csv b.csv

Logistic regression of "off by more than the tolerance" on the statistic s of windows of n frames,
logit = intercept + (slope + slope_of_few / sqrt(n)) s. Both answers weigh the same, so the probability starts from even
odds. Offsets `random` and `none` are used: up to 1 deg and 20 cm.
"""

import argparse
import csv

import numpy


def read(paths):
    for path in paths:
        with open(path) as stream:
            yield from csv.DictReader(stream)


def fit(features, answers, weights):
    """Newton's method."""
    constants = numpy.zeros(features.shape[1])
    for _ in range(50):
        probability = 1.0 / (1.0 + numpy.exp(-features @ constants))
        gradient = features.T @ (weights * (answers - probability))
        hessian = (features * (weights * probability * (1.0 - probability))[:, None]).T @ features
        constants += numpy.linalg.solve(hessian, gradient)
    return constants


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('tables', nargs='+', metavar='CSV', help='of evaluate --monitor')
    parser.add_argument('--rotation-tolerance', type=float, default=0.3, help='[deg]')
    parser.add_argument('--translation-tolerance', type=float, default=0.05, help='[m]')
    arguments = parser.parse_args()
    rows = [row for row in read(arguments.tables) if row['offset'] in ('random', 'none')]
    statistic = numpy.array([float(row['statistic']) for row in rows])
    frames = numpy.array([float(row['frames']) for row in rows])
    off = numpy.array([float(float(row['rotation_deg']) > arguments.rotation_tolerance
                             or float(row['translation_m']) > arguments.translation_tolerance) for row in rows])
    weights = numpy.where(off > 0.5, 0.5 / off.mean(), 0.5 / (1.0 - off).mean())
    features = numpy.column_stack([numpy.ones_like(statistic), statistic, statistic / numpy.sqrt(frames)])
    print('intercept {:.2f}, slope {:.1f}, slope of few {:.1f}; {} windows, {:.0f} % of them off'.format(
        *fit(features, off, weights), len(rows), 100.0 * off.mean()))


if __name__ == '__main__':
    main()
