"""The filters that the cloud-Kalman filter is compared with, each as its literature defines it."""
